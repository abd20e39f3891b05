"""The compiled integrator: a C driver, and the code CasADi generates for each model."""
