"""Scene tables of films."""
