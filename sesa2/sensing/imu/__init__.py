"""Inertial sensors that tell their orientation: how they sit in the arm, and what they get wrong."""
