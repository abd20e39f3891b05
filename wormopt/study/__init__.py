"""Kinds of study: what a user gives, what is computed from it, and when."""
