"""Paths in the plane, put together from the steps of a few gaits."""
