"""Many scenes that differ in a few keys: which they are, what is kept of each, and all of them."""
