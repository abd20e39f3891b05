"""Arcs that end where contacts switch, and prices of bounds, by a slide with a closed form."""

import casadi as ca
import numpy as np
import pytest

from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import FixedModes, SwitchDetection
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.optimise import optimise
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.ocp.switching import optimise_switching_times


def shortest(push: float = 3.0, way: float = 1.0) -> tuple[Problem, Guess]:
    """The shortest slide from rest to rest: T^2 = 2 way (1 / (push - 1) + 1 / (push + 1))."""
    x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    block = Model(
        "block",
        x=[Signal("position", x), Signal("velocity", v)],
        ode=ca.vertcat(v, u + f),
        u=[Signal("drive", u, nominal=2.0, lower=-push, upper=push)],
        contacts=[Contact("sole", v, f, Coulomb(1.0, 2.0))],
    )
    ends = Ends.of(block)
    at_ends = [
        Constraint("start", ends.start, 0, 0),
        Constraint("end", ends.end, [way, 0], [way, 0], nominal=0.5),
    ]
    problem = Problem(block, ends, ends.duration, (0.1, 10.0), boundary_constraints=at_ends)
    return problem, Guess(1.5, lambda t: np.vstack([t / 1.5, 0 * t + 0.7]))


def test_prices_of_bounds_are_the_slopes_of_the_optimum():
    problem, guess = shortest()
    slides = FixedModes(ModeSequence(((1,), (1,))))
    prices = optimise(problem, Mesh.even(2, 1, Collocation(2)), slides, guess).prices
    time = np.sqrt(1.5)
    low, high = prices["drive"]
    assert float(high[0] - low[0]) == pytest.approx(-(1 / 4 + 1 / 16) / time, rel=1e-6)
    low, high = prices["end"]
    assert float(low[0] + high[0]) == pytest.approx(time / 2, rel=1e-6)
    assert prices["duration"][0][0] == pytest.approx(0.0, abs=1e-6)


def test_arcs_end_where_the_push_turns_and_the_block_stops():
    problem, guess = shortest()
    mesh = Mesh(6, 1, Collocation(2, "radau"), spans=(0.05, 0.6))
    detected = optimise(problem, mesh, SwitchDetection(1e-6, first=0.1, ratio=0.03), guess)
    # two thirds of the time the push is ahead
    turn = 2 / 3 * np.sqrt(1.5)
    assert detected.objective == pytest.approx(np.sqrt(1.5), abs=1e-4)
    assert np.min(np.abs(detected.motion.breaks - turn)) < 1e-2
    exact = optimise_switching_times(detected)
    assert exact.objective == pytest.approx(np.sqrt(1.5), abs=1e-9)
