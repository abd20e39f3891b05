"""Uncertainty of a fit: intervals, tests, predictions, draws."""
