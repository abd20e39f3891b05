"""Currents of a row of coils that carry a float fastest, or with least power."""
