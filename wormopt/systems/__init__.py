"""One folder for each physical system: models, what is special to it, scenes, runs, pictures."""
