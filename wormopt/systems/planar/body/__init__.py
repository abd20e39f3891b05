"""The body in the plane: where its points are for a shape, and how its shape goes round."""
