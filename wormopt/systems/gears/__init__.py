"""Worms that shift gears: gaits for every slope, transitions between them, and when to shift."""
