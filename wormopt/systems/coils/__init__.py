"""Coils, their fields and pressures, and materials in these fields."""
