"""Bounds of every gait: never below a motion, sharp where the best is known."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
import pytest
from certified import (
    BEST_OF_ANY_PERIOD,
    BEST_OF_THREE_LINKS,
    SPEED,
    bound_of,
    g1,
    less,
    one_link_speed,
    one_link_tasks,
)
from effort import examples
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, PPoly

import wormopt as wo
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.progress import silent
from wormopt.systems.shared.sequences import Sequence_, is_gait
from wormopt.systems.spiked.certify.bound import Bounded, at_once, bounded
from wormopt.systems.spiked.certify.certificate import Certificate, verify
from wormopt.systems.spiked.certify.program import Level, Outer, Program
from wormopt.systems.spiked.certify.statement import Statement
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.design.optimize import designed as designed_by
from wormopt.systems.spiked.gait_problem import Certify, GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits, Rates
from wormopt.systems.spiked.verify import violations

LEAST_PEAK = 585 / 23  # of G1 at speed 0.75, period 1


@cache
def solved(task: GaitProblem, *level: int) -> float:
    return Program(Outer(Statement.of(task)), Level(*level)).solve(60.0)[0]


def proven(found: Bounded) -> Certificate:
    """The certificate of a bound, after it was verified."""
    assert found.certificate is not None
    assert verify(found.certificate).holds
    return found.certificate


# -- motions that are true by construction -----------------------------------------------------


@dataclass(frozen=True, eq=False)
class Motion:
    """Velocities of all masses as piecewise polynomials, whose integrals are known exactly."""

    sequence: Sequence_
    durations: np.ndarray
    velocity: PPoly

    @property
    def way(self) -> PPoly:
        return self.velocity.antiderivative()

    @property
    def period(self) -> float:
        return float(self.durations.sum())

    @property
    def speed(self) -> float:
        return float(self.way(self.period)[0]) / self.period

    def gait(self, shortest: float) -> Gait:
        """The links' lengths, all of at least ``shortest``."""
        links = -np.diff(self.way.c, axis=2)  # l_j' = v_{j-1} - v_j
        x = self.velocity.x
        least = [least_of(PPoly(links[:, :, j], x)) for j in range(links.shape[2])]
        links[-1] += shortest - np.array(least)
        return Gait(self.velocity.x, links[::-1].transpose(1, 2, 0).copy())


@dataclass(frozen=True)
class Making:
    """How a motion is made."""

    shape: tuple[int, int]
    degree: int
    knots: int
    seed: int
    even: bool = False
    jumps: bool = False
    vanishing: bool = False

    @property
    def links(self) -> int:
        return self.shape[0]

    @property
    def phases(self) -> int:
        return self.shape[1]


def motion_of(making: Making) -> Motion:
    """Masses that rest in the phases of a random sequence, and else move anyhow."""
    random = np.random.default_rng(making.seed)
    masses, degree = making.links + 1, making.degree
    letters = [s for k in range(1, masses) for s in combinations(range(masses), k)]
    words = [w for w in product(letters, repeat=making.phases) if is_gait(w)]
    if making.vanishing:
        words = [w for w in words if not set.intersection(*map(set, w[:-1]))]
    sequence = words[random.integers(len(words))]
    rests = np.array([[i in s for i in range(masses)] for s in sequence])
    durations = random.uniform(0.2, 1.0, making.phases)
    meet = random.uniform(0.0, 1.0, rests.shape) * ~rests * ~np.roll(rests, -1, axis=0)
    if making.vanishing:  # the last phase is an instant at which its masses rest
        durations[-1] = 0.0
        meet[-2:] = meet[-1] * ~rests[-2]
    x, coefficients = [0.0], []
    for p in np.flatnonzero(durations):
        shares = random.uniform(0.3, 1.0, making.knots)
        shares = np.full(making.knots, 1.0) if making.even else shares
        v = random.uniform(0.05, 1.0, (making.knots, degree + 1, masses))
        v[1:, 0] = v[:-1, -1]
        v[0, 0], v[-1, -1] = meet[p - 1], meet[p]
        if making.jumps:  # up from rest, and down to it
            v[0, 0], v[-1, -1] = random.uniform(0.0, 1.0, masses), 0.0
            v[1:, 0] += random.uniform(0.0, 0.3, v[1:, 0].shape)
        coefficients.append(v * ~rests[p])
        x.extend(x[-1] + np.cumsum(shares / shares.sum()) * durations[p])
    c = np.concatenate(coefficients).transpose(1, 0, 2)
    velocity = PPoly.from_bernstein_basis(BPoly(c, np.array(x)))
    scale = 1 / velocity.antiderivative()(x[-1])  # all masses advance by 1
    return Motion(sequence, durations, PPoly(velocity.c * scale, velocity.x))


# Limits that a motion meets are take this much wider: it keeps to them in spite of rounding.
WIDER = 1 + 1e-11


def extremes_as_limits(
    motion: Motion, worm: Worm, margin: float, sharing: str, jumps: bool
) -> tuple[GaitProblem, Crawl]:
    """The worm and limits of which every one is met at some instant."""
    gait = motion.gait(0.1)
    forces = worm.drag * motion.velocity.c
    forces[1:] += worm.masses * motion.velocity.derivative().c
    own = least_of(PPoly(forces.mean(axis=2), motion.velocity.x))
    worm = worm.vary(load=(max(0.0, -own) + margin) * WIDER)
    crawled = crawl(gait, worm.masses, worm.drag, worm.load, sharing)  # type: ignore[arg-type]
    low, high = (v * WIDER for v in crawled.extremes("rate"))
    shortest, longest = crawled.extremes("length")
    given: dict = {
        "period": (motion.period * 0.9, motion.period * 1.2),
        "length": tuple(
            (float(a), float(b)) for a, b in zip(shortest / WIDER, longest * WIDER, strict=True)
        ),
        "rate": Rates(contraction=tuple(-low), extension=tuple(high)),
        "sigma_margin": max(float(crawled.extremes("sigma")[0][0]), 0.0) / WIDER,
        "sharing": sharing,
        "impulses": jumps,
    }
    if not jumps:
        loads = crawled.extremes("reaction")[1]
        # a mass that never rests bears nothing, and no limit may be nothing
        given |= {
            "acceleration": tuple(largest(crawled, "acceleration") * WIDER),
            "spike_load": tuple(np.where(loads > 0, loads, loads.max()) * WIDER),
            "actuator_force": tuple(largest(crawled, "actuator_force") * WIDER),
        }
    return GaitProblem(worm, Limits(**given), SPEED), crawled


def largest(motion: Crawl, signal: str) -> np.ndarray:
    return np.max(np.abs(motion.extremes(signal)), axis=0)


def least_of(curve: PPoly) -> float:
    """Smallest value of a piecewise polynomial, from either side of its breaks."""
    values = [
        np.polyval(piece, [0.0, width, *turns_of(piece, width)])
        for piece, width in zip(curve.c.T, np.diff(curve.x), strict=True)
    ]
    return float(min(v.min() for v in values))


def turns_of(piece: np.ndarray, width: float) -> np.ndarray:
    roots = np.roots(np.polyder(piece))
    return roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < width)]


SHAPES = st.sampled_from([(1, 2), (1, 4), (2, 2), (2, 3), (2, 4), (3, 2), (3, 3)])


def makings(**kinds) -> st.SearchStrategy[Making]:
    return st.builds(
        Making,
        **{"shape": SHAPES} | kinds,
        degree=st.integers(1, 3),
        knots=st.integers(2, 4),
        seed=st.integers(0, 2**32 - 1),
    )


@settings(max_examples=examples(8), derandomize=True)
@given(
    st.one_of(makings(), makings(shape=st.sampled_from([(2, 3), (2, 4)]), vanishing=st.just(True))),
    st.tuples(st.floats(0.1, 10.0), st.floats(0.1, 10.0)),
    st.sampled_from([0.0, 0.3, 3.0]),
    st.sampled_from([0.0, 2.0]),
    st.sampled_from(["equal", "least_actuation"]),
)
def test_no_motion_passes_a_bound_of_its_own_extremes(making, masses, drag, margin, sharing):
    """A motion whose own extremes are the limits: a row too strict would forbid it."""
    motion = motion_of(making)
    assume(making.links < 3)
    mass = np.geomspace(masses[0], masses[1], making.links + 1)
    worm = Worm(links=making.links, mass=tuple(mass), drag=drag)
    task, crawled = extremes_as_limits(motion, worm, margin, sharing, jumps=False)
    assert max(violations(crawled, task.limits).values()) <= 1e-9
    found = bound_of(task, motion.speed, 0.5, 1.0)
    assert found.bound >= motion.speed
    assert found.certificate is None or verify(found.certificate).holds


@pytest.mark.slow
def test_rows_hold_along_a_motion_that_presses_on_every_limit():
    """Of three links too, with a level of one cell, which a motion of its extremes must obey."""
    motion = motion_of(Making((3, 3), 3, 2, 5))
    task, crawled = extremes_as_limits(motion, Worm(3, drag=0.3), 1.0, "equal", jumps=False)
    assert max(violations(crawled, task.limits).values()) <= 1e-9
    assert solved(task, 1, 1, 1) >= motion.speed


# -- bounds that are known -----------------------------------------------------------------------


def coasting() -> tuple[GaitProblem, float]:
    """One link slows down against drag and load alone: m v' = -k v - 2 Gamma; and its speed."""
    k, load = 2.0, 4.0
    stop = np.log(1 + k / (2 * load)) / k
    coasting = (1.0 - 2 * load * stop) / k
    best = (0.5 - stop - 1 / 20) + 1 / 40 + coasting
    task = g1(links=1)
    task = task.vary(worm=Worm(links=1, mass=1.0, drag=k, load=load))
    return task, best


@settings(max_examples=examples(15), derandomize=True)
@given(one_link_tasks())
def test_one_link_is_bounded_by_its_closed_form(task: Any):
    periods = task.limits.period / np.geomspace(1.0, 10.0, 60)  # every shorter one counts
    best = max(one_link_speed(task.worm, task.limits.vary(period=float(t))) for t in periods)
    found = bound_of(task, best, 0.02)
    assert best * (1 - 1e-12) <= found.bound <= best * 1.02  # the best lies between two of these
    proven(found)


def test_one_link_by_hand():
    """Strokes of 0.6 at rate 1 with ramps of 1/20 and 1/10 take 0.675; in a period 1, 0.425."""
    for task, best in ((g1(1), Fraction(4, 9)), (g1(1, period=1.0), Fraction(17, 40))):
        found = bound_of(task, float(best), 1e-5)
        assert found.ending == "gap reached"
        assert found.certificate is not None
        assert best <= found.certificate.bound <= best * (1 + Fraction(1, 10**8))


@pytest.mark.parametrize("task", [g1(1), g1(1, period=1.0, mass=(1.0, 2.0), spike_load=25.0)])
def test_no_program_bounds_one_link_below_its_mean_rate(task: GaitProblem):
    """Some motion within its limits has this mean rate, so that programs are left out."""
    outer = Outer(Statement.of(task))
    mean = outer.statement.mean_rates(outer.strokes, outer.starts, outer.brakes)
    assert min(solved(task, 1, 1, 3), solved(task, 2, 3, 3)) >= mean * (1 - 1e-7)
    assert bound_of(task, 0.9 * mean, 1e-5).source == "by the mean rates of links"


def test_one_link_that_coasts_to_rest():
    """Brakes count as strong as at full speed, where drag helps most."""
    task, best = coasting()
    found = bound_of(task, best, 0.06)
    assert best <= found.bound <= best * 1.06


@pytest.mark.parametrize(
    ("task", "best", "gap"),
    [
        (g1(), BEST_OF_ANY_PERIOD, 0.01),
        (g1(drag=1.0), 0.875274, 0.01),
        (g1(resting=2), 0.303797, 0.005),
        (g1(3, resting=2), 0.606061, 0.012),
        pytest.param(g1(), BEST_OF_ANY_PERIOD, 0.002, marks=pytest.mark.slow),
        pytest.param(g1(period=1.0), 0.825667, 0.01, marks=pytest.mark.slow),
        pytest.param(g1(spike_load=25.0), 0.818182, 0.012, marks=pytest.mark.slow),
        pytest.param(g1(3), BEST_OF_THREE_LINKS, 0.015, marks=pytest.mark.slow),
    ],
)
def test_bounds_come_near_the_best_gaits_known(task: GaitProblem, best: float, gap: float):
    found = bound_of(task, best, gap)
    assert best < found.bound <= best * (1 + gap)
    assert found.ending == "gap reached"
    proven(found)


def test_strokes_that_fit_into_a_short_period_are_proven():
    """Two of three masses rest: three strokes share a period of 1, 0.275 each, as in the gait."""
    found = bound_of(g1(resting=2, period=1.0), 0.275, 0.005)
    assert found.ending == "gap reached"
    assert 0.275 <= found.bound <= 0.275 * 1.005
    file = json.loads(proven(found).text)
    assert all(0.275 <= Fraction(stroke) < 0.28 for stroke in file["proof"]["strokes"])
    first = file["proof"]["stroke_proofs"][0]
    first["bound"] = less(first["bound"])
    assert "exceeds the bound" in verify(Certificate(json.dumps(file))).reason
    del file["proof"]["stroke_proofs"]
    assert "can move by more" in verify(Certificate(json.dumps(file))).reason


def test_finer_programs_bound_more():
    """Each space of W holds the one before."""
    for levels in ([(1, 1, 2), (1, 1, 3), (1, 1, 4), (1, 2, 4)], [(1, 1, 2), (2, 1, 2), (2, 2, 2)]):
        found = [solved(g1(), *level) for level in levels]
        assert all(b < a - 1e-4 for a, b in pairwise(found))
        assert found[-1] > BEST_OF_ANY_PERIOD


def test_bounds_do_not_depend_on_units():
    unlike = {"rate": (1.0, 0.5), "length": ((0.7, 1.3), (0.5, 1.0)), "spike_load": 25.0}
    one = solved(g1(drag=0.5, **unlike), 1, 1, 3)
    m, x, t = 4.0, 1e-3, 0.125  # units of mass, length and time are so many times larger
    force = m * x / t**2
    scaled = {
        "period": (0.1 * t, 100.0 * t),
        "length": ((0.7 * x, 1.3 * x), (0.5 * x, 1.0 * x)),
        "rate": (x / t, 0.5 * x / t),
        "acceleration": 20.0 * x / t**2,
        "spike_load": 25.0 * force,
    }
    other = g1(mass=m, drag=0.5 * m / t, load=5.0 * force, **scaled)
    assert solved(other, 1, 1, 3) * t / x == pytest.approx(one, rel=1e-6)


def test_a_mirrored_worm_has_the_same_bound():
    """Head and tail exchanged, a link that contracts extends."""
    limits = {
        "rate": Rates((1.0, 0.5), (0.8, 0.9)),
        "length": ((0.7, 1.3), (0.7, 1.1)),
        "acceleration": (20.0, 15.0),
        "mass": (1.0, 2.0, 1.5),
        "spike_load": (30.0, 45.0, 40.0),
    }
    image = {key: value[::-1] for key, value in limits.items() if key != "rate"}
    image["rate"] = Rates((0.9, 0.8), (0.5, 1.0))
    assert solved(g1(**limits), 1, 1, 3) == pytest.approx(solved(g1(**image), 1, 1, 3), rel=1e-6)


def test_the_mirror_halves_a_program_and_leaves_its_bound(monkeypatch: pytest.MonkeyPatch):
    halved = solved(g1(), 1, 1, 3)
    monkeypatch.setattr(Program, "_mirrored", False)
    whole = Program(Outer(Statement.of(g1())), Level(1, 1, 3)).solve(60.0)[0]
    assert whole == pytest.approx(halved, rel=1e-6)


def test_limits_hold_under_every_load_of_a_range():
    """Spikes carry the largest load, and hold against the smallest."""
    low, high = (g1(spike_load=30.0, load=load) for load in (4.0, 6.0))
    ranged = solved(g1(spike_load=30.0, load=(4.0, 6.0)), 1, 1, 3)
    assert ranged <= min(solved(low, 1, 1, 3), solved(high, 1, 1, 3)) + 1e-6


def test_tighter_limits_never_raise_a_bound():
    loose = g1(spike_load=30.0, actuator_force=25.0)
    for tighter in ({"spike_load": 25.0}, {"actuator_force": 20.0}, {"sigma_margin": 1.0}):
        limits = loose.limits.vary(**tighter)
        assert solved(loose.vary(limits=limits), 1, 1, 3) <= solved(loose, 1, 1, 3) + 1e-7


def test_a_peak_load_is_bounded_from_below():
    task = g1(objective=Objective("peak_spike_load", 0.75), period=1.0)
    found = bound_of(task, LEAST_PEAK, 0.2)
    assert found.ending == "gap reached"
    assert 0.8 * LEAST_PEAK <= found.bound <= LEAST_PEAK
    certified = proven(found)
    assert certified.bound < 0.75  # no gait of a smaller peak is so fast
    assert Fraction(json.loads(certified.text)["problem"]["spike_load"][0]) <= LEAST_PEAK


def test_long_worms_are_bounded_by_the_mean_rates_of_their_links():
    """n/2 r D/(D + r^2/a), which is below the ceiling of rates n/2 r."""
    found = bound_of(g1(5), 1.9)
    assert found.bound == pytest.approx(2.5 * 0.6 / 0.65, rel=1e-8)
    proven(found)


@pytest.mark.slow
def test_a_robot_that_small_programs_do_not_bound_is_bounded_by_larger_ones():
    """Rates alone give 20 mm/s; a gait of 16.91 mm/s is known."""
    robot = GaitProblem(
        Worm(4, 0.08, load=0.1362),
        Limits(
            period=(2.0, 12.0), length=(0.05, 0.07), rate=0.02, acceleration=0.08, resting=2,
            spike_load=0.5,
        ),
    )  # fmt: skip
    first = at_once(robot)
    assert first is not None
    assert first.bound == pytest.approx(0.02, rel=1e-9)
    assert 0.0169 < bounded(robot, 0.0169, Certify(0.03, 600.0), silent, first).bound < 0.0175


def test_jumps_are_bounded_by_rates_and_resting_masses():
    found = bound_of(g1(impulses=True, acceleration=None), 0.9)
    assert found.bound == pytest.approx(1.0)
    assert found.certificate is None


# -- gaits found by the designer -----------------------------------------------------------------


@st.composite
def tasks(draw: Callable[[Any], Any], links: st.SearchStrategy[int]) -> GaitProblem:
    """Worms and limits, unlike per link and mass."""
    n = draw(links)

    def each(low: float, high: float, count: int) -> tuple[float, ...]:
        return draw(st.tuples(*(st.floats(low, high) for _ in range(count))))

    shortest, room = each(0.3, 0.9, n), each(0.2, 0.8, n)
    load = draw(st.floats(1.0, 8.0))
    worm = Worm(n, mass=each(0.5, 2.0, n + 1), drag=draw(st.sampled_from([0.0, 1.0])), load=load)
    spike = draw(st.none() | st.floats(1.5, 4.0))
    limits = Limits(
        period=draw(st.sampled_from([(0.2, 10.0), 1.0])),
        length=tuple((a, a + b) for a, b in zip(shortest, room, strict=True)),
        rate=Rates(each(0.3, 1.5, n), each(0.3, 1.5, n)),
        acceleration=each(8.0, 40.0, n),
        spike_load=spike and spike * (n + 1) * load,
        resting=draw(st.integers(1, n)),
    )
    return GaitProblem(worm, limits, SPEED)


@settings(max_examples=examples(6), derandomize=True, suppress_health_check=list(HealthCheck))
@given(tasks(st.integers(1, 3)))
def test_no_designed_gait_passes_its_bound(task: GaitProblem):
    try:
        found = designed_by(task, Search(effort="quick", workers=1, time_limit=2.0), silent)
    except SolveError:
        return
    assert max(found.violations.values()) <= 1e-9
    proven = bound_of(task, found.speed, 0.3, 2.0)
    assert proven.bound >= found.speed * (1 - 1e-8)  # what its own violations may have gained
    assert proven.certificate is None or verify(proven.certificate).holds


# -- runs that stop ------------------------------------------------------------------------------


def test_a_tiny_time_limit_is_told():
    found = bound_of(g1(period=1.0), 0.825667, 1e-4, 1e-9)
    assert found.ending == "time limit"
    assert 0.825667 < found.bound <= 1.0


def test_an_interrupted_bound_is_true():
    told: list[float | None] = []

    def report(_: str, fraction: float | None = None) -> None:
        told.append(fraction)
        if len(told) == 4:
            raise KeyboardInterrupt

    found = bounded(g1(), BEST_OF_ANY_PERIOD, Certify(1e-4, 60.0), report)
    assert found.ending == "interrupted"
    assert BEST_OF_ANY_PERIOD < found.bound < 0.93
    assert [b for _, b in found.history] == sorted((b for _, b in found.history), reverse=True)
    assert all(0.0 <= share <= 1.0 for share in told if share is not None)


def test_numbers_that_are_decimals_but_for_rounding_are_those():
    """The limit is 5 or a rounding error more, as sums of decimals leave."""
    limits = Limits(period=1.0, length=(0.5, 1.5), rate=1.0, acceleration=5.000000000000001)
    proof = wo.certify(wo.design(Worm(1, load=2.0), limits, search=Search(effort="quick")))
    assert proof.certificate is not None
    assert verify(proof.certificate).holds
