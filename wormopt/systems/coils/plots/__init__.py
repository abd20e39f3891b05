"""Plots of coils and materials."""
