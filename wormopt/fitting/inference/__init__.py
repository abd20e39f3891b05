"""What a fit knows, and what it does not: intervals, tests, predictions, draws."""
