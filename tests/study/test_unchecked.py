"""Status "unchecked": results that nothing confirms, and theories beyond their range."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wormopt as wo
from wormopt.digest import trust
from wormopt.quantities import Scalar
from wormopt.result import NOT_RECHECKED, Check, Result, Unchecked, left_out
from wormopt.study import load_scene
from wormopt.study.study import status_of
from wormopt.systems.film.units import Fluid

GRAVITY = 9.80665
GOOD, BAD = Check("good", 0.0, 1.0, "fine"), Check("bad", 2.0, 1.0, "too large")
DOUBT = Unchecked("nothing confirms it")


@pytest.fixture(scope="module")
def scene():
    return wo.load_scene("fast_gait")


@pytest.mark.parametrize(
    ("checks", "warnings", "status", "reason"),
    [
        ([GOOD], [], "ok", ""),
        ([GOOD], ["beware"], "ok", ""),
        ([GOOD], ["beware", DOUBT, DOUBT], "unchecked", "nothing confirms it"),
        ([GOOD, BAD], [DOUBT], "failed", "too large"),
        ([], ["beware"], "unchecked", "no check of the numbers was made"),
        ([], [DOUBT], "unchecked", "nothing confirms it"),
    ],
)
def test_status_is_earned(checks: list[Check], warnings: list[str], status: str, reason: str):
    found, reasons = status_of(checks, warnings)
    assert (found, "; ".join(reasons)) == (status, reason)


def test_what_is_left_out_leaves_a_result_unchecked_above_one():
    assert not isinstance(left_out(1.0, "large"), Unchecked)
    assert isinstance(left_out(1.0 + 1e-9, "large"), Unchecked)


def _film(inertia: float, weight: float) -> dict[str, float]:
    """A fluid with such eps Re = d² ω / ν and weight over pressure = g d³ k² / (ν ω)."""
    depth, wavelength, density = 5e-4, 1e-2, 1100.0
    k = 2 * np.pi / wavelength
    frequency = k * np.sqrt(GRAVITY * depth * inertia / weight)
    return {
        "mu_r": 1.05, "viscosity": density * depth**2 * frequency / inertia, "density": density,
        "surface_tension": 0.03, "depth": depth, "wavelength": wavelength, "frequency": frequency,
    }  # fmt: skip


FLOAT = {"schema": 1, "kind": "float", "units": "SI", "floats": {"length": [0.0]}}


def test_a_float_beyond_lubrication_is_unchecked():
    """eps Re = 10, and the film weighs 30 times the pressure."""
    fluid = _film(10.0, 30.0)
    known = Fluid(**fluid)
    assert known.eps * known.reynolds == pytest.approx(10.0)
    assert known.gravity == pytest.approx(30.0)
    result = wo.run({**FLOAT, "film": {"delta": 0.3, "fluid": fluid}})
    assert result.status == "unchecked"
    assert "eps Re is 10" in result.reason
    assert "rho g d / P is 30" in result.reason
    assert next(iter(trust(result))).startswith("unchecked: ")


def test_a_film_within_lubrication_is_accepted():
    result = wo.run({**FLOAT, "film": {"delta": 0.3, "fluid": _film(0.05, 0.09)}})
    assert result.status == "ok", result.reason


@given(st.floats(0.01, 50.0), st.floats(0.01, 50.0))
def test_fluids_are_trusted_just_where_all_shares_are_small(inertia: float, weight: float):
    doubts = [w for w in Fluid(**_film(inertia, weight)).warnings() if isinstance(w, Unchecked)]
    beyond = sum(share > 1 for share in (inertia, weight))
    assert abs(inertia - 1) < 1e-9 or abs(weight - 1) < 1e-9 or len(doubts) == beyond


@pytest.mark.parametrize("kind", ["film-flow", "film-body", "film-forward"])
def test_all_kinds_of_films_are_alike(kind: str):
    fluid = _film(10.0, 30.0)
    scene: dict[str, Any] = {
        "schema": 1, "kind": kind, "units": "SI", "film": {"delta": 0.3, "fluid": fluid},
    }  # fmt: skip
    if kind == "film-body":
        scene["body"] = {
            "on": "ground", "length": 0.1, "height": 0.2, "density": 2000.0,
            "friction_coefficient": 0.5,
        }  # fmt: skip
        scene |= {"time": {"periods": 1}, "tolerance": {"recheck": False}}
    if kind == "film-forward":
        scene |= {"time": {"periods": 1}, "grid": {"points": 32, "most": 32}}
    result = wo.run(scene)
    assert result.status == "unchecked", result.reason
    assert "eps Re is 10" in result.reason


SMALL_COMPARISON = {
    "draws.members": 2,
    "time.end": 0.5,
    "tube.capture": 0.2,
    "reference": [
        {"name": "gait (15)", "gait": {"shape": "fast", "period": 1.0, "rest_length": 2.0,
                                       "elongation": 0.15}},
    ],
    "tracker": [
        {"name": "(13)", "feedback": "derivative", "tube_radius": 0.2, "growth": 100.0},
    ],
}  # fmt: skip


@pytest.mark.parametrize("recheck", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_comparison_that_no_second_route_confirms_says_it_is_not_checked(recheck: bool):
    """Trackers, and LQR through delayed measurements, take too long in Python."""
    changes = {
        **SMALL_COMPARISON, "tolerance.recheck": recheck, "hardware.delay": 0.02,
    }  # fmt: skip
    result = wo.run("compare_over", changes)
    assert result.status == "unchecked"
    assert result.reason == NOT_RECHECKED or "no second route rechecks" in result.reason
    assert result["recheck_error"].value is None
    told = list(trust(result))
    assert told[0].startswith("unchecked")
    assert "second route: not taken" in told
    assert not any("unknown" in line for line in itertools.islice(told, 2))


@pytest.mark.parametrize("value", [None, [None, None], [[None], [None]]])
def test_a_number_of_no_second_route_is_not_taken(value: Any):
    result = Result("a", "gait", scalars={"recheck_error": Scalar(value)})
    assert "second route: not taken" in trust(result)


@pytest.mark.parametrize(("eps", "status"), [(1.0, "ok"), (2.0, "unchecked"), (4.0, "unchecked")])
def test_a_film_whose_next_order_is_larger_than_its_flow_is_unchecked(eps: float, status: str):
    """The cosine wave of amplitude 1/2: flow 1/3, next order 0.93 of it squared at eps 2."""
    result = wo.run(load_scene("fig15_film_flow", [f"film.eps={eps}"]))
    assert result.status == status
