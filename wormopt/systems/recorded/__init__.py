"""Fits of model parameters to recordings, and planned experiments."""
