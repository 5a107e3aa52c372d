"""Magnetometers in an arm that has magnets in its backbone: what they read of its shape, and how they fail."""
