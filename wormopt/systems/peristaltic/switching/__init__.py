"""Coils that are on or off: the best times and order of switching them."""
