"""Proofs of how much better a gait could be, by branch and bound."""
