"""Direct collocation: any Model in, a checked nonlinear program and its solution out."""
