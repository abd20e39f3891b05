"""Parameters from recordings: recordings, unknowns, the fit and its uncertainty."""
