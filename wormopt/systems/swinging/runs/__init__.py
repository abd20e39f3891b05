"""Runs of kinds about swinging masses."""
