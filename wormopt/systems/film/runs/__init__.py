"""Runners of the kinds of scenes about films."""
