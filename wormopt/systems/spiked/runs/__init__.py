"""Runs of kinds about gaits."""
