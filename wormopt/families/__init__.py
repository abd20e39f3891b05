# pyright: strict
"""Families: one study at many points, which are kept, and collected as one result."""
