"""Gaits that anchor in a tube: waves, bounds of their speed, the fastest gait, slips."""
