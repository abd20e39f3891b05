"""Runs of kinds about peristaltic worms."""
