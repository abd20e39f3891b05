"""Runners of the kinds of scenes about the pair."""
