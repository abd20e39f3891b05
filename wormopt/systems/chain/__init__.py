"""Chains of point masses under friction: trackers, optimal inputs, their comparison."""
