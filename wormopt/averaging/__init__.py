"""Averaging over a fast phase, and the steady states of what is left."""
