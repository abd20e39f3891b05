"""The nouns: models, contacts, friction laws, modes, gaits, paths."""
