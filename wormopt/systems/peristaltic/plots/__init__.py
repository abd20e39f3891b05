"""Pictures of peristaltic worms."""
