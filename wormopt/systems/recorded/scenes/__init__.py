"""Tables of scenes about recorded worms."""
