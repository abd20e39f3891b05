"""Certificates: bounds that no true gait passes, true optima that they come close to."""

from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product
from math import sqrt

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, PPoly
from scipy.optimize import brentq

from wormopt.core.gait import Gait
from wormopt.gaits import relaxation as relaxation_module
from wormopt.gaits.attempt import Job, Task, attempt
from wormopt.gaits.certify import certify
from wormopt.gaits.optimize import gait_of_arcs
from wormopt.gaits.polish import as_found
from wormopt.gaits.relaxation import Box, Relaxation, Relaxed
from wormopt.gaits.scaled_limits import Form, ScaledLimits
from wormopt.gaits.sequences import Sequence_, is_gait
from wormopt.gaits.tree import Branch, Solver, Tree, grow, planted
from wormopt.gaits.verify import violations
from wormopt.progress import silent
from wormopt.scenes.gait_design import GaitLimits, Objective, RateLimits
from wormopt.scenes.gait_search import Certify, Search
from wormopt.scenes.worm import WormTable
from wormopt.worms.crawl import Crawl, crawl

G1 = 14 * sqrt(1394) / 125 - 839 / 250  # theory: masses rest in the order 0, 2, 1
G1_ORDER = ((0,), (2,), (1,))
# Shares of the period; 0.95 and the rest follow from G1's trapezoids, the first from its optimum.
G1_DURATIONS = (0.4725297607185565, 0.4774702392814435, 0.05)
LEAST_PEAK = 585 / 23  # of G1 at speed 0.75
SPEED = Objective(maximise="speed")


def g1(links: int = 2, objective: Objective = SPEED, **changed) -> Task:
    limits = GaitLimits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    limits = msgspec.structs.replace(limits, **changed)
    return Task(WormTable(links=links, mass=1.0, load=5.0), limits, objective)


def proof(task: Task, value: float, gap: float = 1e-3, report=silent, **changed):
    options = {"phases": 4, "time_limit": 120.0, "sequence": None, "workers": 1} | changed
    wanted = Certify(phases=options["phases"], gap=gap, time_limit=options["time_limit"])
    own = Search(certify=wanted, sequence=options["sequence"], workers=options["workers"])
    return certify(task, value, own, report, options.get("begun"))


def check_bound(bound: float, speed: float) -> None:
    """What every relaxation must keep: it is never below the speed of a gait."""
    assert bound >= speed * (1 - 1e-12)


def point(durations) -> Box:
    return tuple((float(h), float(h)) for h in durations)


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
    def edges(self) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(self.durations)])

    @property
    def speed(self) -> float:
        return float(self.way(self.period)[0]) / self.period

    def gait(self, shortest: float) -> Gait:
        """The links' lengths, all of at least ``shortest``."""
        links = -np.diff(self.way.c, axis=2)  # l_j' = v_{j-1} - v_j
        longest_fall = np.abs(links[-1]).max(axis=0) + np.abs(links[:-1]).sum(axis=(0, 1))
        links[-1] += shortest + longest_fall
        return Gait(self.velocity.x, links[::-1].transpose(1, 2, 0).copy())

    def before(self, t: float) -> np.ndarray:
        """Velocities on the left of an instant."""
        piece = max(int(np.searchsorted(self.velocity.x, t - 1e-12 * self.period)) - 1, 0)
        return np.polyval(self.velocity.c[:, piece], t - self.velocity.x[piece])


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


# Limits that a motion meets are taken this much wider: it keeps to them in spite of rounding.
WIDER = 1 + 1e-11


def extremes_as_limits(
    motion: Motion, worm: WormTable, margin: float, sharing: str, jumps: bool
) -> tuple[Task, Crawl]:
    """The worm and limits of which every one is met at some instant."""
    gait, n = motion.gait(0.1), worm.links
    heavy = crawl(gait, worm.masses, worm.drag, 1e6)
    own = float(heavy.extremes("sigma")[0][0]) - 1e6
    worm = msgspec.structs.replace(worm, load=(max(0.0, -own) + margin) * WIDER)
    crawled = crawl(gait, worm.masses, worm.drag, worm.load, sharing)  # type: ignore[arg-type]
    low, high = (v * WIDER for v in crawled.extremes("rate"))
    shortest, longest = crawled.extremes("length")
    given: dict = {
        "period": (motion.period * 0.9, motion.period * 1.2),
        "length": tuple(
            (float(a), float(b)) for a, b in zip(shortest / WIDER, longest * WIDER, strict=True)
        ),
        "rate": RateLimits(contraction=tuple(-low), extension=tuple(high)),
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
    assert len(given["length"]) == n
    return Task(worm, GaitLimits(**given), SPEED), crawled


def largest(motion: Crawl, signal: str) -> np.ndarray:
    return np.max(np.abs(motion.extremes(signal)), axis=0)


def own_values(motion: Motion, program: Relaxation) -> np.ndarray:
    """The motion as a point of the relaxation: what its columns stand for."""
    limits, m = program._limits, program._cells
    x = np.zeros(len(program._upper))

    def put(columns: np.ndarray, values: np.ndarray) -> None:
        kept = columns >= 0
        # what has no column is zero
        assert np.abs(values[~kept]).max(initial=0.0) <= 1e-9
        x[columns[kept]] = values[kept]

    way, start_lengths = motion.way, np.array(limits.task.limits.length_ranges(limits.links))[:, 0]
    offset = motion_offset(motion, start_lengths)
    for p, (start, stop) in enumerate(pairwise(motion.edges)):
        h = motion.durations[p] / limits.time
        t = np.linspace(start, stop, m + 1)
        v = motion.velocity(t)
        v[-1] = motion.before(stop)
        mean = np.diff(way(t), axis=0) * m / limits.time / limits.speed  # h times velocity
        put(program._h[p : p + 1], np.array([h]))
        put(program._g[p : p + 1], np.array([h**2]))
        put(program._y[p], h * v / limits.speed)
        put(program._q[p], mean)
        put(program._z[p], h * mean if limits.drag else 0 * mean)
        lengths = offset - np.diff(way(t[:-1]), axis=1)
        put(program._l[p], (lengths - start_lengths) / limits.speed / limits.time)
        at_end = motion.velocity(stop % motion.period if p + 1 < len(motion.durations) else 0.0)
        put(program._c[p], at_end / limits.speed if program._continuous else 0 * at_end)
    x[program._way] = way(motion.period)[0] / limits.speed / limits.time
    return x


def motion_offset(motion: Motion, shortest: np.ndarray) -> np.ndarray:
    """Lengths at the start with which every link is at its shortest at some instant."""
    links = PPoly(-np.diff(motion.way.c, axis=2), motion.way.x)
    turns = [
        np.concatenate([links.x, *(r for r in [roots_of(links, j)] if len(r))])
        for j in range(len(shortest))
    ]
    least = [links(t)[:, j].min() for j, t in enumerate(turns)]
    return shortest * WIDER - np.array(least)


def roots_of(links: PPoly, j: int) -> np.ndarray:
    rate = PPoly(links.c[:, :, j], links.x).derivative()
    roots = rate.roots(extrapolate=False)
    return roots[np.isfinite(roots)]


def excess(program: Relaxation, x: np.ndarray, box: Box) -> float:
    """Largest violation of any row or bound by a point, relative to the row's terms."""
    low, high, _ = program._tighten(np.array(box))
    program._set_box(low, high)
    lp = program._program
    value, size = lp._matrix @ x, abs(lp._matrix) @ np.abs(x) + 1e-3
    rows = np.maximum(lp._row_lower - value, value - lp._row_upper) / size
    return float(max(rows.max(), (lp._lower - x).max(), (x - lp._upper).max()))


def box_around(motion: Motion, task: Task, widths: np.ndarray) -> Box:
    """A box of shares of the longest period that holds the durations."""
    share = motion.durations / task.limits.period_range[1]
    low, high = np.maximum(share - widths, 0.0), np.minimum(share + widths[::-1], 1.0)
    return tuple(zip(low.tolist(), high.tolist(), strict=True))


SHAPES = st.sampled_from([(1, 2), (1, 4), (2, 2), (2, 3), (2, 4), (3, 2), (3, 3)])


def makings(**kinds) -> st.SearchStrategy[Making]:
    return st.builds(
        Making,
        **{"shape": SHAPES} | kinds,
        degree=st.integers(1, 3),
        knots=st.integers(2, 4),
        seed=st.integers(0, 2**32 - 1),
    )


@settings(
    max_examples=15, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
@given(
    st.one_of(
        makings(),
        makings(jumps=st.just(True)),
        makings(shape=st.sampled_from([(2, 3), (2, 4), (3, 3)]), vanishing=st.just(True)),
    ),
    st.tuples(st.floats(0.1, 10.0), st.floats(0.1, 10.0)),
    st.sampled_from([0.0, 0.3, 3.0]),
    st.sampled_from([0.0, 2.0]),
    st.sampled_from(["equal", "least_actuation"]),
    st.sampled_from([1, 3, 7]),
)
def test_a_true_motion_is_a_point_of_the_relaxation(making, masses, drag, margin, sharing, cells):
    """Whatever the solver does: the motion's own values obey every row, in any box."""
    motion = motion_of(making)
    mass = np.geomspace(*masses, making.links + 1)
    worm = WormTable(links=making.links, mass=tuple(mass), drag=drag)
    task, crawled = extremes_as_limits(motion, worm, margin, sharing, making.jumps)
    # the second route agrees that it is a gait within these limits
    assert max(violations(crawled, task.limits).values()) <= 1e-9
    assert crawled.speed == pytest.approx(motion.speed, rel=1e-11)
    program = Relaxation(task, motion.sequence, cells, 0.7 * motion.speed)
    x = own_values(motion, program)
    random = np.random.default_rng(making.seed)
    for widths in (np.zeros(making.phases), random.uniform(0, 0.3, making.phases)):
        box = box_around(motion, task, widths)
        assert excess(program, x, box) <= 1e-12
        check_bound(program.solve(box).bound, motion.speed)
    check_bound(program.solve(program.root).bound, motion.speed)
