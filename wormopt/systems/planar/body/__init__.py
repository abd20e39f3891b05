"""The body in the plane: its points by its shape, strokes of the shape, poses, and obstacles."""
