"""Runs of kinds about recorded worms."""
