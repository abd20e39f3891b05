"""Methods that compute without wormopt's solvers, for tests, benchmarks and stress tests."""
