"""Runners of the kinds of scenes about chains."""
