"""A block on dry ground."""
