"""Runs of scenes of planar worms."""
