"""Plots of worms in a channel."""
