"""Motions in time: contacts exact or smooth, events located."""
