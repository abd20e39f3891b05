"""A block on dry ground, moved by a bounded force."""
