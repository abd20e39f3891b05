"""Pictures of coils and materials."""
