"""Currents for a float by the mean field: a wave that holds it, and currents for its field.

The two successive designs ignore the ripple and ends of a row, and the effect of the float on the
film: a cosine wave, the H² that holds it up against weight, surface tension and viscosity, and the
currents whose H² is closest to that in the interior of the row.
"""

from __future__ import annotations

import math

import numpy as np

from wormopt.errors import SolveError
from wormopt.magnetics.coils import CoilRow
from wormopt.ocp.nlp import Ipopt
from wormopt.systems.coils.design.pattern import Form, Pattern
from wormopt.systems.coils.layer import Layer
from wormopt.systems.coils.row_currents import TravellingTarget, fit_currents
from wormopt.systems.film import CosineWave, Fluid

_MARGIN, _PLACES = 3, 3


def wave_pattern(
    layer: Layer, row: CoilRow, ground: float, delta: float, rate: float, repeat: int,
    per_step: int, *, form: Form = "ramps", slew: float | None = None,
) -> Pattern | None:  # fmt: skip
    """Return currents whose mean field holds a cosine wave of amplitude `delta`, or None.

    The wave is `repeat` coils long. The field is that at the surface of the flat film, with its
    magnetisation in weak fields.
    """
    magnet, wavelength = layer.fluid, repeat * row.pitch
    chi = magnet.magnetisation.chi
    turn = 2 * math.pi * rate / repeat
    film = Fluid(
        1 + chi, layer.viscosity, magnet.density, magnet.surface_tension, layer.depth, wavelength,
        turn,
    )  # fmt: skip
    wave, unit = CosineWave(delta), float(film.field(1.0)) ** 2
    # the weight of a wave of one harmonic acts like a tension
    held = film.tension + magnet.weight * layer.depth / film.pressure
    target = TravellingTarget(
        lambda xi: unit * np.asarray(wave.field_function(xi, held)),
        unit * wave.peak(held).value,
        wavelength,
        repeat / rate,
    )
    margin = min(_MARGIN, (row.count - 2) // 2)
    low, high = row.places[margin], row.places[-1 - margin]
    places = np.linspace(low, high, _PLACES * (row.count - 1 - 2 * margin) + 1)
    try:
        fit = fit_currents(
            row, target, places, ground + layer.depth, nodes=repeat * per_step, slew=slew,
            starts=3, options=Ipopt(),
        )  # fmt: skip
    except SolveError:
        return None
    return Pattern(_held(fit.nodes, form), rate, per_step, form)


def _held(nodes: np.ndarray, form: Form) -> np.ndarray:
    """Return corners of a polyline; for values that hold, the means of its pieces."""
    return nodes if form == "ramps" else (nodes + np.roll(nodes, -1)) / 2
