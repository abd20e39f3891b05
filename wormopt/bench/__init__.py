"""Benchmarks and the stress matrix: how fast `simulate` is, and whether it is right."""

CASES = ("track13", "track14", "mag2", "spiked_chain", "stick_chain", "chain_length")
"""Names of the benchmarks, here so that the command line can tell them without loading any."""
