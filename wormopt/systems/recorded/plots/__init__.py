"""Pictures of recorded worms."""
