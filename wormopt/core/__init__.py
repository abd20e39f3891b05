"""The nouns every builder and solver shares: models, friction laws, mode sequences, gaits."""
