"""The search over orders of rest."""
