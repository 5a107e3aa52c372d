"""Logs of one file a sensor, as the makers of IMUs write them."""
