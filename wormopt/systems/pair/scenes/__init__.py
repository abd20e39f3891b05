"""Scene tables of the pair."""
