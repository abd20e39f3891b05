"""Scene tables of chains."""
