"""Averages, steady states, linear theory, vibrations, states of rest."""
