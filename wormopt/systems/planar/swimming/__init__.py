"""Viscous crawling: local connection, curvature, displacement of strokes, best strokes."""
