"""Benchmarks: the time that solvers take, and their errors."""

CASES = {
    "track13": "the chapter's worm under tracker (13), smooth law",
    "track14": "the same under tracker (14)",
    "mag2": "two masses on a spring, dry friction, 369 events",
    "spiked_chain": "a driven chain on spikes, exact contact",
    "stick_chain": "a driven chain that sticks and slips, exact contact",
    "ensembles": "many worms on springs that differ, in lanes beside one after the other",
    "smoothing": "the smooth law of ever smaller v_reg beside the exact one",
    "chain_length": "time of a step for 2 to 1000 links",
    "averaging": "averages of the magneto-elastic pair, beside samples and quadrature",
    "film": "a film over switched coils, beside SciPy on the same equations",
    "planar_block": "a block in the plane that stops under a load, beside SciPy and MuJoCo",
    "planar_elliptic": "the same on ground that resists more sideways",
    "planar_tripod": "a rigid tripod that pivots on a foot before it rests",
    "planar_triangle": "three driven masses that stick and slip in the plane",
    "planar_crawl": "three links that crawl slowly, beside SciPy at even instants",
    "ocp": "the fastest smooth slide by optimal control, time to build and to solve",
    "certificate": "bounds on the speed of G1 against its exact optimum",
    "rod_statics": "a rod that a force bends far, beside scikit-fem, PyElastica and SciPy",
    "rod_dynamics": "natural frequencies of a thick rod, beside scikit-fem and SciPy",
    "elastica": "a segment from wall to wall, beside SciPy",
    "coils": "the field of a thick coil, beside magpylib",
    "steady": "a resonance curve through steady states, beside SciPy's root finders",
    "sensitivities": "derivatives of a motion, beside differences and diffrax",
    "design": "random gait-design problems, seconds to come near the bound on the speed",
}
"""Benchmarks and what they are, here so that the command line can tell without loading any."""

LADDERS = {
    **dict.fromkeys(("track13", "track14", "mag2", "spiked_chain", "stick_chain"), "peers"),
    **{f"planar_{k}": "planar" for k in ("block", "elliptic", "tripod", "triangle", "crawl")},
    "averaging": "averaging",
    "smoothing": "smoothing",
    "ensembles": "ensembles",
    "film": "film",
    "certificate": "certificate",
    "rod_statics": "rod_statics",
    "rod_dynamics": "rod_dynamics",
    "elastica": "segment",
    "coils": "coils",
    "steady": "steady",
    "sensitivities": "sensitivities",
}
"""Which of them are a `tests.benchmarks.ladder`, and the modules that say what is asked."""
