"""Profiles that rest: surfaces over an interval that hold a given area, along a load."""
