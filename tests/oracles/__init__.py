"""Methods that share no code with wormopt, for tests, benchmarks and the stress matrix."""
