"""The best gait of one order of rest as a bilinear program."""
