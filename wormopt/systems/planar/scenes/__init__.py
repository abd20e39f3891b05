"""Scene tables of planar worms."""
