"""Optimal waves of a film."""
