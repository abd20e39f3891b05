"""Scene tables of gaits and their design."""
