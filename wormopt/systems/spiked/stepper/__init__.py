"""Gaits on stepping motors, and how the worm then moves."""
