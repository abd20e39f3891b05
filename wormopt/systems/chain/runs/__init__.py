"""Runs of kinds about chains."""
