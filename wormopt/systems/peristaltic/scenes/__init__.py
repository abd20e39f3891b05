"""Scene tables of peristaltic worms."""
