"""Gaits that anchor in a tube: waves, ceilings on their speed, the fastest one, slides."""
