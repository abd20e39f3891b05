"""Runs of kinds about the pair."""
