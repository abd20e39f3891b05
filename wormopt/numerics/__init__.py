"""Chebyshev series, boundary values, linear and bilinear programs, work in several processes."""
