"""Proprioception for soft continuum arms: the arm's shape from the orientations of IMUs along it."""
