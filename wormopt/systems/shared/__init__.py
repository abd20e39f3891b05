"""Code common to the runs of several systems: signals, trust reports."""
