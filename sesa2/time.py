"""Stamps are whole nanoseconds inside the package, so that none is rounded on its way; all else is seconds."""

NS = 1_000_000_000  # nanoseconds in a second
