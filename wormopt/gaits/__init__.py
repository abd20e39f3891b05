"""Gait design: constructed gaits, the search over mode sequences, and its polish."""
