"""Estimates against motion capture."""
