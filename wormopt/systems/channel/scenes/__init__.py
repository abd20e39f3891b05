"""Scene tables of worms in a channel."""
