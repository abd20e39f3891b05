"""Gait design for planar worms by optimal control: fast, turning, cheap, and through passages."""
