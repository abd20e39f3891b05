"""Derivatives of motions: along which directions, by which equations, where there are none."""
