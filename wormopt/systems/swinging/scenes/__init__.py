"""Scene tables of swinging masses."""
