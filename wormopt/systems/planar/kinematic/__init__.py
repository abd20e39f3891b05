"""Motions that pins and skids determine, and what these must bear."""
