"""Pictures of films."""
