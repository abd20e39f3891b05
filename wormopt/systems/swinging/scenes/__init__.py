"""Scene tables of oscillating masses."""
