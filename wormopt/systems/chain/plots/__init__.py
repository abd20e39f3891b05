"""Pictures of chains in motion."""
