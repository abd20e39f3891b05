"""Derivatives of motions: directions, variational equations, and points without derivatives."""
