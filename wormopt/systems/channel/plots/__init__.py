"""Pictures of worms in a channel."""
