"""Pictures of planar worms."""
