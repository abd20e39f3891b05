"""Worms that were recorded: their numbers found from what was measured."""
