"""What runs of several systems share: signals, trust reports, checkpoints."""
