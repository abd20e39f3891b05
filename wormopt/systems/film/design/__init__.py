"""The best wave of a film."""
