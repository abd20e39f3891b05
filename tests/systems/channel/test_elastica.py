"""Elastica between two walls: equations, solver, elliptic integrals, energies."""

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import gamma

from wormopt.errors import ArgumentError, SolveError
from wormopt.numerics.boundary_values import BoundaryProblem, BoundarySolution, solve_boundary
from wormopt.systems.channel.closed_forms import ChannelWorm
from wormopt.systems.channel.segments import (
    SLEEVE_RISE,
    Closing,
    ExactElastica,
    elastica,
    exact_elastica,
    slender_guess,
)

BOTH: tuple[Any, ...] = ("point_contact", "sleeve")
# Rises of sample 2, the capsule and sample 1 over the coil distance, and others.
RISES = (0.01, 0.55, 0.6, 0.7, 1.2, 1.66)


def solve(closing: Closing, rise: float, **options: Any) -> BoundarySolution:
    small = min(rise, 0.2)
    return solve_boundary(
        elastica(closing), lambda s: slender_guess(closing, small, s), [[small], [rise]], **options
    )


def held_at(length: float, rise: float) -> BoundarySolution:
    """Elastica of a given length, followed from the sleeve's."""
    free = solve("sleeve", rise)
    path = [[rise, free.p[0]], [rise, length]]
    return solve_boundary(elastica("length"), lambda s: (free.at(s), free.p), path)


@pytest.mark.parametrize("rise", RISES)
@pytest.mark.parametrize("closing", BOTH)
def test_collocation_finds_what_elliptic_integrals_give(closing: Any, rise: float):
    found, exact = solve(closing, rise), exact_elastica(closing, rise)
    assert found.p[0] == pytest.approx(exact.length, rel=1e-13)
    assert found.p[1] == pytest.approx(exact.reaction, rel=1e-12)
    assert found.p[2] == pytest.approx(exact.tension, rel=1e-12, abs=1e-13)
    assert found.at([1.0])[4, 0] == pytest.approx(exact.energy, rel=1e-11)
    assert found.at([0.0])[1, 0] == pytest.approx(exact.curvature, rel=1e-12)
    share = np.linspace(0, 1, 33)
    states = found.at(share)
    wanted = exact.points(share)
    for state, row in ((2, wanted[0]), (3, wanted[1]), (0, wanted[2])):
        assert states[state] == pytest.approx(row, abs=1e-12)
    assert max(found.tail, found.defect, found.residual) < 1e-12


@pytest.mark.parametrize("closing", BOTH)
def test_a_run_of_an_integrator_from_the_wall_arrives_at_the_other(closing: Any):
    exact = exact_elastica(closing, 0.7)
    V, N = exact.reaction, exact.tension

    def rates(_: float, y: np.ndarray) -> list[float]:
        theta, bend = y[0], -V * math.cos(y[0]) + N * math.sin(y[0])
        return [y[1], bend, math.cos(theta), math.sin(theta), y[1] ** 2 / 2]

    start = [0, exact.curvature, 0, 0, 0]
    end = solve_ivp(rates, (0, exact.length), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert end == pytest.approx([0, -exact.curvature, 1, 0.7, exact.energy], abs=1e-11)


def test_lengths_in_mm():
    """By DOP853 shooting; in all, both closings differ in the second decimal."""
    wanted = {
        "sample-1": (12.6348729, 12.6856497),
        "sample-2": (11.6905192, 11.7112838),
        "capsule": (11.9874614, 12.0162257),
    }
    for name, lengths in wanted.items():
        worm = ChannelWorm.of(name)
        found = [1e3 * worm.pitch * solve(c, worm.rise / worm.pitch).p[0] for c in BOTH]
        assert found == pytest.approx(list(lengths), abs=1e-6)


def test_small_rises_give_the_beam():
    """12 E I rise / L³ and, to second order, the length 1 + 3 rise² / 5, from (34)."""
    for closing in BOTH:
        found = exact_elastica(closing, 1e-3)
        assert found.reaction == pytest.approx(12e-3, rel=1e-4)
        assert (found.length - 1) / 1e-6 == pytest.approx(0.6, rel=1e-4)
        assert found.energy == pytest.approx(6e-6, rel=1e-4)


@pytest.mark.parametrize("closing", BOTH)
def test_each_rise_has_one_segment(closing: Any):
    """Rises grow with the largest angle, so that there is no second root."""
    rises = [ExactElastica(closing, d).rise for d in np.geomspace(1.5707, 1e-9, 400)]
    assert np.all(np.diff(rises) > 0)
    assert rises[0] < 1e-3


def test_a_segment_of_free_length_leaves_the_walls_at_1_67_spans():
    """There the wall no longer pushes: 2 over the integral of the root of sin to a right angle."""
    lemniscate = math.sqrt(2 / math.pi) * gamma(0.75) ** 2
    assert pytest.approx(2 / lemniscate, rel=1e-14) == SLEEVE_RISE
    assert exact_elastica("sleeve", SLEEVE_RISE).reaction == pytest.approx(0, abs=1e-7)
    assert solve("sleeve", SLEEVE_RISE).p[1] == pytest.approx(0, abs=1e-11)
    assert solve("sleeve", 1.01 * SLEEVE_RISE).p[1] < 0  # the walls would have to pull
    with pytest.raises(ArgumentError, match=r"1\.66925\]"):
        exact_elastica("sleeve", 1.01 * SLEEVE_RISE)


def test_point_contact_takes_any_rise():
    """Steep segments are upright but for two bends of the curvature 4 / L each."""
    exact = exact_elastica("point_contact", 10.0)
    assert exact.curvature == pytest.approx(4, rel=1e-9)
    assert exact.reaction == pytest.approx(8, rel=1e-9)
    found = solve("point_contact", 10.0)
    assert found.p[0] == pytest.approx(exact.length, rel=1e-10)
    assert exact.length - 10 == pytest.approx(math.sqrt(2) - 1, abs=1e-8)
    with pytest.raises(ArgumentError, match="must be in"):
        exact_elastica("point_contact", 100.0)


@pytest.mark.parametrize("rise", [0.3, pytest.param(0.7, marks=pytest.mark.slow), 1.5])
def test_of_all_lengths_the_sleeve_s_has_the_least_energy(rise: float):
    free, exact = solve("sleeve", rise), exact_elastica("sleeve", rise)
    least = free.at([1.0])[4, 0]
    assert least < exact_elastica("point_contact", rise).energy
    step = 0.02 * (exact.length - math.hypot(1, rise))
    near = [held_at(exact.length + k * step, rise) for k in (-2, -1, 1, 2)]
    energies = [one.at([1.0])[4, 0] for one in near]
    assert energies[0] > energies[1] > least < energies[2] < energies[3]
    # energy falls with length at the rate of the Hamiltonian, here by differences of 4th order
    for one, sign in zip(near, (1, 1, -1, -1), strict=True):
        rate = one.at([0.0])[1, 0] ** 2 / 2 + one.p[2]
        assert sign * rate > 0
    slope = (energies[0] - 8 * energies[1] + 8 * energies[2] - energies[3]) / (12 * step)
    assert slope == pytest.approx(0, abs=1e-4 * least)


@pytest.mark.slow
def test_the_rate_of_energy_with_length_is_the_hamiltonian():
    L, step = 1.24, 1e-4
    ends = [held_at(L + k * step, 0.7).at([1.0])[4, 0] for k in (-1, 1)]
    middle = held_at(L, 0.7)
    rate = middle.at([0.0])[1, 0] ** 2 / 2 + middle.p[2]
    assert (ends[1] - ends[0]) / (2 * step) == pytest.approx(-rate, rel=1e-4)


def test_point_contact_is_the_given_length_that_needs_no_tension():
    exact = exact_elastica("point_contact", 0.7)
    held = held_at(exact.length, 0.7)
    assert held.p[1:] == pytest.approx([exact.reaction, 0.0], abs=1e-10)


def test_the_error_falls_geometrically_with_the_degree():
    exact = exact_elastica("point_contact", 0.7)
    errors = [
        abs(solve("point_contact", 0.7, degree=n, most=n, tolerance=1.0).p[1] / exact.reaction - 1)
        for n in (6, 10, 14)
    ]
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 50
    assert errors[2] < errors[1] / 50


def test_what_is_not_resolved_and_a_guess_that_leads_nowhere_are_told():
    with pytest.raises(SolveError, match="do not resolve") as caught:
        solve("point_contact", 5.0, degree=16, most=32)
    assert caught.value.code == "unresolved"

    def nowhere(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.full((5, len(s)), np.nan), np.zeros(3)

    with pytest.raises(SolveError, match="first guess") as caught:
        solve_boundary(elastica("sleeve"), nowhere, [[0.7]])
    assert caught.value.code == "no_start"


def test_a_branch_that_ends_is_told():
    """y' = 0, p² = 1 - given: no solution past given = 1."""
    y, start, end, p, load = (ca.SX.sym(name) for name in ("y", "start", "end", "p", "load"))
    both = ca.vertcat(start, p * p - 1 + load)
    problem = BoundaryProblem(y, p, load, 0 * y, start, end, both, ("y",))

    def near(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((1, len(s))), np.ones(1)

    found = solve_boundary(problem, near, [[0.0], [0.75]], degree=8)
    assert found.p[0] == pytest.approx(0.5, rel=1e-12)
    with pytest.raises(SolveError, match="ended at") as caught:
        solve_boundary(problem, near, [[0.0], [2.0]], degree=8)
    assert caught.value.code == "lost"


def test_wrong_problems_are_refused():
    with pytest.raises(ArgumentError, match="closing must be one of"):
        elastica("free")  # pyright: ignore[reportArgumentType]
    y, start, end, p, load = (ca.SX.sym(name) for name in ("y", "start", "end", "p", "load"))
    with pytest.raises(ArgumentError, match="need 2 conditions, not 1"):
        BoundaryProblem(y, p, load, y, start, end, start, ("y",))
    with pytest.raises(ArgumentError, match="one entry for each state"):
        BoundaryProblem(y, p, load, y, start, end, ca.vertcat(start, end), ("y", "z"))
