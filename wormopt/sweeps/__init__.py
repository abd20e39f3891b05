"""Sweeps of scenes that differ in a few keys: points, stored results, and the whole."""
