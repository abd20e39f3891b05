"""Coils that are on or off: optimal times and order of switching."""
