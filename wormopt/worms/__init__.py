"""Physical systems, one per file: each builder returns a Model and knows no solver."""
