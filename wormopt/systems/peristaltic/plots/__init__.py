"""Plots of peristaltic worms."""
