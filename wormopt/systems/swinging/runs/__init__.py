"""Runners of the kinds of scenes about oscillating masses."""
