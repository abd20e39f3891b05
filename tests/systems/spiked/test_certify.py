"""Bounds of every gait: never below a motion, sharp where the best is known, verified exactly."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
import pytest
from effort import examples
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, PPoly
from scipy.optimize import root_scalar

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError, SolveError
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

SPEED = Objective()
ANY = (0.1, 100.0)
# Best gaits of G1's worm that are known, found by independent searches.
BEST_OF_ANY_PERIOD, BEST_OF_THREE_LINKS = 0.869449, 1.28049
LEAST_PEAK = 585 / 23  # of G1 at speed 0.75, period 1


def g1(links: int = 2, objective: Objective = SPEED, **changed: Any) -> GaitProblem:
    worm = {name: changed.pop(name) for name in ("mass", "drag", "load") if name in changed}
    given_ = {"period": ANY, "length": (0.7, 1.3), "rate": 1.0, "acceleration": 20.0}
    return GaitProblem(Worm(links, **{"load": 5.0} | worm), Limits(**given_ | changed), objective)


@cache
def solved(task: GaitProblem, *level: int) -> float:
    return Program(Outer(Statement.of(task)), Level(*level)).solve(60.0)[0]


def bound_of(task: GaitProblem, value: float, gap: float = 0.01, seconds: float = 600.0) -> Bounded:
    return bounded(task, value, Certify(gap, seconds), silent)


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
    st.one_of(
        makings(),
        makings(shape=st.sampled_from([(2, 3), (2, 4)]), vanishing=st.just(True)),
    ),
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


def one_link_speed(worm: Worm, limits: Limits) -> float:
    """Largest speed of two masses that rest in turn, k = 0, one stroke in and one out.

    A mass speeds up as the link and the other's spike allow, runs at the link's rate, and slows
    down as the link and sigma allow. Both strokes have one length, in times that fill the period.
    """
    (contraction,), (extension,) = limits.rate_limits(1) or ((np.inf,), (np.inf,))
    link = np.inf if limits.acceleration is None else float(np.max(limits.acceleration))
    spike = np.inf if limits.spike_load is None else float(np.max(limits.spike_load))
    load, period = worm.load_range[0], limits.period_range[0]

    def stroke(h: float, mass: float, rate: float) -> float:
        up = min(link, (spike - 2 * load) / mass)
        down = min(link, 2 * (load - limits.sigma_margin) / mass)
        ramps = 1 / up + 1 / down
        top = min(rate, h / ramps)
        return top * h - top**2 / 2 * ramps

    def apart(h: float) -> float:
        return stroke(h, worm.masses[1], contraction) - stroke(
            period - h, worm.masses[0], extension
        )

    h = float(root_scalar(apart, bracket=(1e-9, period - 1e-9), xtol=1e-15, rtol=1e-14).root)
    way = min(stroke(h, worm.masses[1], contraction), np.ptp(limits.length_ranges(1)))
    return float(way / period)


one_links = st.builds(
    dict,
    masses=st.tuples(st.floats(0.2, 3.0), st.floats(0.2, 3.0)),
    load=st.floats(2.0, 20.0),
    room=st.floats(0.05, 1.5),
    contraction=st.floats(0.3, 2.0),
    extension=st.floats(0.3, 2.0),
    acceleration=st.floats(5.0, 50.0),
    spike=st.one_of(st.none(), st.floats(1.2, 4.0)),
    margin=st.one_of(st.just(0.0), st.floats(1e-9, 0.8)),
    period=st.floats(0.5, 2.0),
)


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
@given(one_links)
def test_one_link_is_bounded_by_its_closed_form(given_):
    load = given_["load"]
    limits = Limits(
        period=given_["period"],
        length=(0.3, 0.3 + given_["room"]),
        rate=Rates(contraction=given_["contraction"], extension=given_["extension"]),
        acceleration=given_["acceleration"],
        spike_load=None if given_["spike"] is None else 2 * load * given_["spike"],
        sigma_margin=load * given_["margin"],
    )
    task = GaitProblem(Worm(links=1, mass=given_["masses"], load=load), limits, SPEED)
    periods = given_["period"] / np.geomspace(1.0, 10.0, 60)  # every shorter one counts
    best = max(one_link_speed(task.worm, limits.vary(period=float(t))) for t in periods)
    found = bound_of(task, best, 0.02)
    assert best * (1 - 1e-12) <= found.bound <= best * 1.02  # the best lies between two of these
    assert found.certificate is not None
    assert verify(found.certificate).holds


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
    assert found.certificate is not None
    assert verify(found.certificate).holds


def test_strokes_that_fit_into_a_short_period_are_proven():
    """Two of three masses rest: three strokes share a period of 1, 0.275 each, as in the gait."""
    found = bound_of(g1(resting=2, period=1.0), 0.275, 0.005)
    assert found.ending == "gap reached"
    assert 0.275 <= found.bound <= 0.275 * 1.005
    assert found.certificate is not None
    assert verify(found.certificate).holds
    file = json.loads(found.certificate.text)
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
    assert found.certificate is not None
    assert verify(found.certificate).holds
    assert found.certificate.bound < 0.75  # no gait of a smaller peak is so fast
    assert Fraction(json.loads(found.certificate.text)["problem"]["spike_load"][0]) <= LEAST_PEAK


def test_long_worms_are_bounded_by_the_mean_rates_of_their_links():
    """n/2 r D/(D + r^2/a), which is below the ceiling of rates n/2 r."""
    found = bound_of(g1(5), 1.9)
    assert found.bound == pytest.approx(2.5 * 0.6 / 0.65, rel=1e-8)
    assert found.certificate is not None
    assert verify(found.certificate).holds


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


def check_designed(task: GaitProblem) -> None:
    try:
        found = designed_by(task, Search(effort="quick", workers=1, time_limit=2.0), silent)
    except SolveError:
        return
    assert max(found.violations.values()) <= 1e-9
    proven = bound_of(task, found.speed, 0.3, 2.0)
    assert proven.bound >= found.speed * (1 - 1e-8)  # what its own violations may have gained
    assert proven.certificate is None or verify(proven.certificate).holds


@settings(max_examples=examples(2), derandomize=True, suppress_health_check=list(HealthCheck))
@given(tasks(st.just(2)))
def test_no_designed_gait_passes_its_bound(task: GaitProblem):
    check_designed(task)


@pytest.mark.slow
@settings(max_examples=examples(30), derandomize=True, suppress_health_check=list(HealthCheck))
@given(tasks(st.integers(1, 3)))
def test_no_designed_gait_passes_its_bound_for_many_limits(task: GaitProblem):
    check_designed(task)


# -- files and their verification ----------------------------------------------------------------


@cache
def certificate(task: GaitProblem, *level: int) -> Certificate:
    outer = Outer(Statement.of(task))
    bound, proof = Program(outer, Level(*level)).solve(60.0)
    return Certificate.of(outer.statement.fields, proof, Fraction(bound) + Fraction(1, 10**8))


SPIKED = g1(spike_load=25.0, actuator_force=20.0, drag=0.5)


@pytest.mark.parametrize(
    "task", [g1(), SPIKED, g1(3, resting=2), g1(rate=(1.0, 0.6), length=((0.7, 1.3), (0.7, 1.1)))]
)
def test_certificates_are_verified_exactly(task: GaitProblem):
    found = verify(certificate(task, 1, 1, 2))
    assert found.holds, found.reason
    assert found.inequalities > 100


def test_a_certificate_of_three_links_is_verified_exactly():
    """Linear in the velocities: 48 simplices, in half a second."""
    found = verify(certificate(g1(3), 1, 1, 1))
    assert found.holds, found.reason
    assert BEST_OF_THREE_LINKS < found.bound < 1.5


def changed(task: GaitProblem, change: Callable[[Any], None]) -> Certificate:
    file = json.loads(certificate(task, 1, 1, 2).text)
    change(file)
    return Certificate(json.dumps(file))


def less(number: str, share: str = "0.999") -> str:
    return str(Fraction(number) * Fraction(share))


def more(number: str) -> str:
    return less(number, "1.001")


BROKEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "a bound that is lower": (lambda f: f.update(bound=less(f["bound"])), "exceeds the bound"),
    "a sign of W": (
        lambda f: f["proof"].update(values=[[-x for x in v] for v in f["proof"]["values"]]),
        "exceeds the bound",
    ),
    "a coefficient": (
        lambda f: f["proof"]["values"][3].__setitem__(0, f["proof"]["values"][3][0] + 10**6),
        "exceeds the bound",
    ),
    "a larger load": (lambda f: f["problem"].update(load=["6", "6"]), "exceeds the bound"),
    "a smaller margin": (
        lambda f: f["problem"].update(sigma_margin="-1"),
        "exceeds the bound",
    ),
    "stronger spikes": (
        lambda f: f["problem"].update(spike_load=["30"] * 3),
        "exceeds the bound",
    ),
    "stronger actuators": (
        lambda f: f["problem"].update(actuator_force=["30"] * 2),
        "exceeds the bound",
    ),
    "less drag": (lambda f: f["problem"].update(drag="0.1"), "exceeds the bound"),
    "a faster link": (
        lambda f: f["problem"]["rates"][1].__setitem__(0, "1.001"),
        "link 0 can be faster",
    ),
    "a quicker link": (lambda f: f["problem"].update(acceleration=["21", "20"]), "accelerates by"),
    "a longer link": (
        lambda f: f["problem"]["length"].__setitem__(0, ["0.7", "1.4"]),
        "link 0 can move by more",
    ),
    "a shorter stroke": (
        lambda f: f["proof"]["strokes"].__setitem__(1, less(f["proof"]["strokes"][1])),
        "link 1 can move by more",
    ),
    "weaker brakes": (
        lambda f: f["proof"]["brakes"][1].__setitem__(0, less(f["proof"]["brakes"][1][0])),
        "link 0 accelerates by",
    ),
    "a piece left out": (lambda f: f["proof"]["pieces"].pop(), "no piece lies beyond|a gap"),
    "a piece twice": (
        lambda f: f["proof"]["pieces"].append(f["proof"]["pieces"][0]),
        "overlap|a gap",
    ),
    "a piece moved": (
        lambda f: f["proof"]["vertices"].__setitem__(0, [x + 1 for x in f["proof"]["vertices"][0]]),
        "",
    ),
    "other resting masses": (lambda f: f["problem"].update(resting=2), "masses rest"),
    "no cells": (lambda f: f["proof"].update(cells=0), "no cells"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_certificate_is_not_verified(name: str):
    change, said = BROKEN[name]
    found = verify(changed(SPIKED, change))
    assert not found.holds
    assert any(part in found.reason for part in said.split("|")), found.reason


def test_a_broken_certificate_of_mean_rates_is_not_verified():
    proven = bound_of(g1(5), 1.9).certificate
    assert proven is not None
    file = json.loads(proven.text)
    file["bound"] = less(file["bound"])
    assert "mean rates" in verify(Certificate(json.dumps(file))).reason
    file = json.loads(proven.text)
    file["proof"]["brakes"][0][0] = "19"
    assert "below its acceleration" in verify(Certificate(json.dumps(file))).reason


def test_the_command_verifies_a_file(tmp_path, capsys: pytest.CaptureFixture[str]):
    good, bad, none = (tmp_path / f"{name}.json" for name in ("good", "bad", "none"))
    certificate(g1(), 1, 1, 2).save(good)
    assert verify(good).holds
    assert wo.verify(str(good)).holds
    assert main(["verify", str(good)]) == 0
    assert "no gait is faster than" in capsys.readouterr().out
    bad.write_text(changed(g1(), BROKEN["a bound that is lower"][0]).text)
    assert main(["verify", str(bad)]) == 3
    assert "not verified: dW/dt" in capsys.readouterr().err
    assert main(["verify", str(none)]) == 2
    assert "none.json: No such file" in capsys.readouterr().err


def test_strokes_are_rounded_up_from_what_is_proven():
    """They were rounded down by what the last digits of floats may be off: not verified."""
    worm = Worm(links=3, mass=(1.9752096437611943, 1.0, 1.320529048672694, 0.5), load=6.29336757)
    rate = (1.3728651274683445, 1.4607125195623956, 1.238089937382999)
    low = (0.4203364253546264, 0.6575655446053759, 0.8734806309272474)
    high = (1.188261913845055, 1.214853091485605, 1.4077341618810624)
    limits = Limits(
        period=1.0,
        length=tuple(zip(low, high, strict=True)),
        resting=3,
        rate=Rates(contraction=rate, extension=rate),
        acceleration=(34.60666055673868, 13.994626096661797, 9.5),
    )
    found = at_once(GaitProblem(worm, limits))
    assert found is not None
    assert found.certificate is not None
    assert verify(found.certificate).reason == ""


def test_forces_that_no_gait_can_keep_leave_the_bound_of_rates():
    """A spike holds 4 at most where a load of 15 pulls: no acceleration keeps all limits."""
    limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0, spike_load=4.0)
    found = at_once(GaitProblem(Worm(links=2, load=5.0), limits))
    assert found is not None
    assert found.bound <= 1.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not a certificate: Expecting"),
        ("[]", '"format" must be "wormopt certificate"'),
        ('{"format": "wormopt certificate", "version": 2}', "version 2 is not known; only 1 is"),
        ('{"format": "wormopt certificate", "version": 1}', "'problem' is missing"),
    ],
)
def test_what_is_no_certificate_is_refused(text: str, said: str, tmp_path):
    file = tmp_path / "c.json"
    file.write_text(text)
    with pytest.raises(ArgumentError) as refused:
        verify(file)
    assert said in str(refused.value)
    assert str(file) in str(refused.value)


@pytest.mark.parametrize("key", ["masses", "rates", "sharing", "length"])
def test_a_certificate_without_a_key_is_refused(key: str):
    with pytest.raises(ArgumentError, match=f"'{key}' is missing"):
        verify(changed(g1(), lambda f: f["problem"].pop(key)))


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
