"""Plots of planar worms."""
