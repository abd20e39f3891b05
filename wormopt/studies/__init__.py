"""One file per scene kind: the only place where a scene, a builder and a solver meet."""
