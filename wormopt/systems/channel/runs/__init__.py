"""Runs of kinds about worms in a channel."""
