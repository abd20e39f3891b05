"""Worms driven by oscillating internal masses, or by masses with prescribed oscillations."""
