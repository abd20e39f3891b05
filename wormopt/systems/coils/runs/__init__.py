"""Runs of kinds about coils and materials."""
