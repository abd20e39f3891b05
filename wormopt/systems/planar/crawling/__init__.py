"""Slow crawling on dry ground: velocities of least power, their phases, and where a stroke ends."""
