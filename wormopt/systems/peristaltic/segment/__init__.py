"""One segment: a sealed membrane in its coil and tube; inflated, wound, its true shape."""
