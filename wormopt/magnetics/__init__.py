"""Magnetic materials and what sets them in motion; like worms, it knows no solver."""
