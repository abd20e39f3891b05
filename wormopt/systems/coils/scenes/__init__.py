"""Scene tables of coils and materials."""
