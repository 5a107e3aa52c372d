"""Recordings: reading, writing, replaying offline."""
