"""Trackers and linear-quadratic control: a plant and a reference make a closed loop."""
