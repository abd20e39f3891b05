"""Coils, the fields and pressures they make, materials in them."""
