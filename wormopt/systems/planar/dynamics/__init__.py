"""Dynamics in the plane: chains of masses, and bodies with prescribed shape."""
