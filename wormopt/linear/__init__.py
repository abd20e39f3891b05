"""Linear analysis of a Model: zeros, poles, relative degree, frequency response."""
