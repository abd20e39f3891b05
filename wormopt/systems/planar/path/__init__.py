"""Paths in the plane, composed of steps of a few gaits."""
