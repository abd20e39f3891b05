"""Runs of kinds about films."""
