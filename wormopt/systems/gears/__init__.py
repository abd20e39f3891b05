"""Worms that shift gears: gaits for every slope, the ways between them, and when to shift."""
