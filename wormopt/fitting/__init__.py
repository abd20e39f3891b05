"""From recordings to numbers: recordings, unknowns, the fit and how well it is known."""
