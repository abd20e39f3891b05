"""Dynamics in the plane: chains of masses, and bodies whose shape is prescribed."""
