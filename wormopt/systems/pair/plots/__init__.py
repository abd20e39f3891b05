"""Pictures of the pair."""
