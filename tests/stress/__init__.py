"""The stress matrix: hard cases of everything, each beside a route that shares no code."""

GROUPS = {
    "motions": "simulated chains and trackers: closed forms, event loops, CVODES, LSODA",
    "planar": "masses on dry ground in the plane: slowed time, event loops",
    "gaits": "crawls, designed and certified gaits: steps of Moreau, closed forms",
    "optima": "optimal control: times and costs in closed form, steps without events",
    "averages": "averages of first and second order: quadrature",
    "films": "waves, floats and films in given fields: quadrature, spectra",
    "bodies": "elastica and vibrations of rods: shooting, beams",
    "fields": "coils and rows of coils: loops by elliptic integrals, dipoles",
    "segments": "peristaltic worms: least power, quadrature, steps without events",
    "swimmers": "strokes and slow crawls in the plane: resistive forces, least power",
}
"""Groups, and what judges them; here so that the command line can tell without loading any."""
