"""Slow crawling on dry ground: velocities of least power, phases of rest, and displacements."""
