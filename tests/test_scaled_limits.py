"""Limits of a design task as linear forms: what is left of each, against the forces themselves."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp
from scipy.optimize import linprog

from wormopt.systems.spiked.limits import Limits, Rates, Sharing
from wormopt.systems.spiked.programs.scaled_limits import Form, ScaledLimits, Slope
from wormopt.systems.spiked.sharing import share_load
from wormopt.systems.spiked.task import GaitProblem, Objective, Worm

LOAD = 2.0
STRENGTHS = (10.0, 20.0, 40.0, 30.0)


def scaled(sharing: Sharing = "equal", load: tuple[float, float] | float = LOAD) -> ScaledLimits:
    limits = Limits(
        period=(2.0, 4.0),
        length=((0.7, 1.3), (0.7, 1.0), (0.5, 1.3)),
        rate=Rates((1.0, 2.0, 1.5), (0.5, 1.0, 3.0)),
        acceleration=(20.0, 20.0, 30.0),
        spike_load=STRENGTHS,
        actuator_force=(15.0, 25.0, 18.0),
        sigma_margin=0.5,
        sharing=sharing,
    )
    worm = Worm(links=3, mass=(1.0, 2.0, 0.5, 1.5), drag=0.3, load=load)
    return ScaledLimits(GaitProblem(worm, limits, Objective()))


def test_forces_as_such_have_no_limits():
    """Weights 1 to 4 of masses 1, 2, 0.5, 1.5 with a mean of 1.25."""
    form = scaled().weighted(np.arange(1.0, 5.0))
    assert (form.below, form.above, form.shared) == (np.inf, np.inf, 0.0)
    assert form.alpha == pytest.approx(np.array([1, 4, 1.5, 6]) / 1.25)
    assert form.beta == pytest.approx([1, 2, 3, 4])


@pytest.mark.parametrize(
    ("sharing", "resting", "more", "most"),
    [
        # alike: together as much as the weakest allows
        ("equal", (0, 2), 0, 2 * 10),
        ("equal", (1, 2, 3), 0, 3 * 20),
        ("equal", (2,), 0, 40),
        ("equal", (1, 2), 1, 3 * 20),
        # as they like: together as much as each can; others that rest may be the strongest
        ("least_actuation", (0, 2), 0, 10 + 40),
        ("least_actuation", (0,), 1, 10 + 40),
        ("least_actuation", (0,), 2, 10 + 40 + 30),
        ("least_actuation", (2,), 1, 40 + 30),
    ],
)
def test_spikes_together_carry_what_their_sharing_allows(
    sharing: Sharing, resting: tuple[int, ...], more: int, most: float
):
    limits = scaled(sharing)
    forms = limits.forms(resting, more)
    (form,) = [f for f in forms if np.all(f.beta == 1)]
    assert form.above * limits.force == pytest.approx(most - 4 * LOAD, rel=1e-12)
    assert form.below * limits.force == pytest.approx(4 * (LOAD - 0.5), rel=1e-12)
    known = len(resting) * min(STRENGTHS[i] for i in resting)
    if sharing == "least_actuation":
        known = sum(STRENGTHS[i] for i in resting)
    assert form.shared * limits.force == pytest.approx(most - known, rel=1e-12)
    assert [f.shared for f in forms if f is not form] == [0.0] * (len(forms) - 1)


def test_what_is_not_limited_has_no_form_and_no_share():
    """Without limits on actuators there are the links and the sum of the reactions."""
    limits = scaled()
    free = replace(limits.task.limits, spike_load=None, actuator_force=None)
    *links, whole = ScaledLimits(replace(limits.task, limits=free)).forms((0, 2), 1)
    assert [whole.above, whole.shared] == [np.inf, 0.0]
    assert len(links) == 3
    free = replace(free, acceleration=None, impulses=True)
    nothing = ScaledLimits(replace(limits.task, limits=free))
    *links, _ = nothing.forms((0, 2))
    assert [(f.below, f.above) for f in links] == [(np.inf, np.inf)] * 3
    assert [*nothing.spikes, *nothing.actuator_most] == [np.inf] * 7


def test_limits_are_widened_by_a_rounding_of_what_they_are_the_difference_of():
    limits = scaled(load=(1.0, 3.0))
    above = [(20, 12), (15, -1), (25, 6), (18, 3)]  # what is borne at most, and what at rest
    below = [(4, 2), (-3, -15), (2, -25), (1, -18)]  # what at rest, and what at least
    for form, *pairs in zip(limits.forms((1,))[3:], above, below, strict=True):
        for side, (high, low) in zip((form.above, form.below), pairs, strict=True):
            with mp.workdps(40):
                wider = mp.mpf(side) * mp.mpf(limits.force) - (high - low)
            assert 5e-15 < wider / (abs(high) + abs(low)) < 1.5e-14


def test_a_worm_may_rest_where_its_spikes_and_actuators_bear_the_load():
    """Of 4 masses 0 and 2 bear 2 G each, and the actuators G, nothing and G."""
    load = 3.0
    exact: dict = {"spike_load": 2 * load, "actuator_force": load, "sigma_margin": load}
    limits = scaled(load=load)

    def rests(**changed) -> bool:
        given_ = replace(limits.task.limits, **(exact | changed))
        return ScaledLimits(replace(limits.task, limits=given_)).admits_rest((0, 2))

    assert rests()
    assert not rests(spike_load=2 * load * (1 - 1e-9))
    assert not rests(actuator_force=load * (1 - 1e-9))
    assert not rests(sigma_margin=load * (1 + 1e-9))


def test_every_load_of_a_range_is_kept_to():
    limits = scaled(load=(1.0, 3.0))
    (form,) = [f for f in limits.forms((1,)) if np.all(f.beta == 1)]
    assert form.above * limits.force == pytest.approx(20 - 4 * 3, rel=1e-12)
    assert form.below * limits.force == pytest.approx(4 * (1 - 0.5), rel=1e-12)


@settings(max_examples=examples(60))
@given(
    st.sets(st.integers(0, 3), min_size=1, max_size=3),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["equal", "least_actuation"]),
)
def test_what_forms_leave_is_what_the_recursion_of_forces_leaves(
    rest: set[int], seed: int, sharing: Sharing
):
    """Of links' accelerations, the weakest spike's load and every actuator's force, both ways.

    Where several spikes share the load as they like, only all they bear together is known.
    """
    limits, resting = scaled(sharing), tuple(sorted(rest))
    given_, worm = limits.task.limits, limits.task.worm
    random = np.random.default_rng(seed)
    moves = np.isin(np.arange(4), resting, invert=True)
    a, v = random.normal(0, 5, 4) * moves, random.uniform(0, 1, 4) * moves
    mass = np.array(worm.masses)
    unloaded = -np.cumsum(mass * a + worm.drag * v + LOAD)
    total = -unloaded[-1]
    loads = share_load(np.array([total]), unloaded[:, None], resting, "equal")[:, 0]
    force = (unloaded + np.cumsum(loads))[:-1]
    links = a[:-1] - a[1:]
    upper = np.concatenate(
        [
            np.array(given_.acceleration, float) - links,
            [len(resting) * (min(STRENGTHS[i] for i in resting) - loads[list(resting)].max())],
            np.array(given_.actuator_force, float) - force,
        ]
    )
    lower = np.concatenate(
        [
            np.array(given_.acceleration, float) + links,
            [total - 4 * 0.5],
            np.array(given_.actuator_force, float) + force,
        ]
    )
    if sharing == "least_actuation":
        upper[3] = sum(STRENGTHS[i] for i in resting) - total
    forms, known = limits.forms(resting), 7 if sharing == "equal" or len(resting) == 1 else 4
    upper, lower = upper[:known], lower[:known]
    assert len(forms) == known
    scale_a = limits.time / limits.speed
    values = [f.alpha @ a * scale_a + limits.drag * f.beta @ v / limits.speed for f in forms]
    units = np.array([1 / scale_a] * 3 + [limits.force] * (known - 3))
    left = np.array([(f.above, f.below) for f in forms]).T + np.array([-1, 1])[:, None] * values
    assert left * units == pytest.approx(np.array([upper, lower]), abs=1e-9)
    whole = limits.weighted(weights := random.normal(size=4))
    scaled_force = whole.alpha @ a * scale_a + limits.drag * whole.beta @ v / limits.speed
    assert scaled_force * limits.force == pytest.approx(weights @ (mass * a + worm.drag * v))
    assert (whole.below, whole.above) == (np.inf, np.inf)


def test_velocities_are_those_that_rates_allow_from_the_nearest_at_rest():
    limits = scaled()
    speeds = limits.fastest((1,)) * limits.speed
    # ahead: the first link extends; behind: the second contracts, then the third too
    assert speeds == pytest.approx([0.5, 0.0, 2.0, 3.5], rel=1e-12)
    speeds = limits.fastest((0, 3)) * limits.speed
    assert speeds == pytest.approx([0.0, 1.0, 3.0, 0.0], rel=1e-12)


def test_units_are_the_largest_rate_the_longest_period_and_the_mean_mass():
    limits = scaled()
    assert (limits.speed, limits.time, limits.mean_mass) == (3.0, 4.0, 1.25)
    assert (limits.shortest_period, limits.longest_period) == (0.5, 1.0)
    assert limits.strokes == pytest.approx(np.array([0.6, 0.3, 0.8]) / 12, rel=1e-12)
    assert limits.force == pytest.approx(1.25 * 3 / 4, rel=1e-12)
    assert limits.drag == pytest.approx(0.3 * 4 / 1.25, rel=1e-12)
    assert limits.spikes * limits.force == pytest.approx(STRENGTHS, rel=1e-12)
    assert limits.actuator_most * limits.force == pytest.approx([15.0, 25.0, 18.0], rel=1e-12)
    double = replace(limits.task.limits, period=8.0, rate=6.0)
    other = ScaledLimits(replace(limits.task, limits=double), like=limits)
    assert (other.speed, other.time, other.longest_period) == (3.0, 4.0, 2.0)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("more", "helps"), [(1.5, True), (1.7, False)])
def test_drag_takes_from_a_rise_the_least_and_gives_a_fall_the_most(
    sign: int, more: float, helps: bool
):
    """Of s = v0 + v2 under -below <= s' + k (2 v0 + 4 v2) <= above, with mass 1 at rest.

    As 2 s <= 2 v0 + 4 v2 <= 4 s, s rises at most at above - 2 k s and falls at below + 4 k s. The
    first says more than the accelerations of the two masses do if it does at the largest s. Of -s
    the two change places.
    """
    limits = scaled()
    k, most = 0.3 * 4 / 1.25, np.array([0.5, 2.0]) / 3
    by_links = 2 * 20.0 * 4 / 3
    rise = [Slope(by_links)] + [Slope(by_links + more, 2 * k)] * helps
    fall = [Slope(1 + k * np.dot([2, 4], most)), Slope(1.0, 4 * k, longest=True)]
    sides, expected = (1.0, by_links + more), product(fall, rise)
    if sign < 0:
        sides, expected = sides[::-1], product(rise, fall)
    form = Form(sign * np.array([1.0, 0, 1, 0]), sign * np.array([2.0, 0, 4, 0]), *sides)
    courses = limits.courses(form, (1,))
    assert np.array(courses) == pytest.approx(np.array(list(expected)), rel=1e-12)


# -- what a limit says of velocities, by linear programs and by every corner -----------------------


@dataclass(frozen=True, eq=False)
class Drawn:
    """A limit on a random worm, and the sets in which accelerations and velocities lie."""

    limits: ScaledLimits
    form: Form
    resting: tuple[int, ...]
    one_sign: bool

    @property
    def most(self) -> np.ndarray:
        """Largest velocities."""
        return self.limits.fastest(self.resting)

    @property
    def drags(self) -> np.ndarray:
        return self.limits.drag * self.form.beta

    def largest(self, sign: int, decay: float) -> float:
        """Most of sign (alpha a + decay alpha v) within the limit on that side and the links'."""
        form, n = self.form, len(self.most)
        side = form.above if sign > 0 else form.below
        step = np.diff(np.eye(n), axis=0)
        force = np.concatenate([form.alpha, self.drags])
        rows, most = [sign * force], [min(side, 1e9)]
        if self.limits.acceleration is not None:
            steps = np.hstack([step, 0.0 * step])
            rows += [*steps, *-steps]
            most += [*self.limits.acceleration, *self.limits.acceleration]
        ways = [(None, None) if v else (0.0, 0.0) for v in self.most]
        cost = -sign * np.concatenate([form.alpha, decay * form.alpha])
        found = linprog(cost, rows, most, bounds=[*ways, *((0.0, v) for v in self.most)])
        return {0: -(found.fun or 0.0), 2: -np.inf, 3: np.inf}[found.status]

    def holds(self, sign: int, decay: np.ndarray | float) -> np.ndarray:
        """Whether drag alone obeys sign s' <= -decay sign s at all velocities."""
        left = sign * (np.multiply.outer(decay, self.form.alpha) - self.drags) * self.most
        return np.maximum(left, 0.0).sum(axis=-1) <= 1e-12

    def span(self) -> tuple[float, float]:
        """Of alpha v: in corners of velocities, or of rates counted from one that rests."""
        alpha, (into, out) = self.form.alpha * (self.most > 0.0), self.limits.rates
        found = [np.array([*product(*((0.0, v) for v in self.most))]) @ alpha]
        rates = np.array([*product(*zip(-into, out, strict=True))])  # of v_j - v_{j+1}
        for m in self.resting:
            v = np.hstack([np.zeros((len(rates), 1)), -np.cumsum(rates, axis=1)])
            found.append((v - v[:, m : m + 1]) @ alpha)
        return max(float(f.min()) for f in found), min(float(f.max()) for f in found)


def drawn(seed: int) -> Drawn:
    random = np.random.default_rng(seed)
    links = int(random.integers(1, 5))
    few = random.integers(3) < 2
    resting = random.permutation(links + 1)[: 1 if few else random.integers(1, links + 1)]
    jumps = random.random() < 0.25
    limits = Limits(
        period=2.0,
        length=(0.7, 1.3),
        rate=Rates(tuple(random.uniform(0.2, 1.0, links)), tuple(random.uniform(0.2, 1.0, links))),
        acceleration=None if jumps else tuple(random.uniform(0.5, 3.0, links)),
        impulses=jumps,
    )
    worm = Worm(links=links, mass=1.0, drag=float(random.choice([0.0, 0.3, 1.0])))
    signs = [np.ones(links + 1), -np.ones(links + 1), random.choice([-1.0, 1.0], links + 1)]
    weights = random.uniform(0.1, 2.0, links + 1) * signs[random.choice([0, 1, 2, 2])]
    moving = np.setdiff1d(np.arange(links + 1), resting)
    weights[random.choice([*resting, *moving[1:]])] *= random.integers(2)
    alpha = weights * random.uniform(0.2, 2.0, links + 1)
    sides = random.choice([-0.2, 0.1, 0.7, 2.0, 8.0, np.inf], 2)
    form = Form(alpha, weights * random.integers(2), *map(float, sides))
    own = np.sign(alpha[moving])
    task = GaitProblem(worm, limits, Objective())
    one = bool(np.all(own >= 0) or np.all(own <= 0))
    return Drawn(ScaledLimits(task), form, tuple(sorted(resting.tolist())), one)


def test_spans_are_met_in_a_corner_of_velocities_or_of_rates():
    for seed in range(200):
        case = drawn(seed)
        span = case.limits.span(case.form.alpha, case.resting)
        assert span == pytest.approx(case.span(), abs=1e-12), seed


def test_slopes_are_those_of_linear_programs():
    """None is passed; where one link's limit cannot hold another mass back all are reached."""
    for seed in range(examples(100)):
        case = drawn(seed)
        slopes = case.limits.slopes(case.form, case.resting)
        for sign, slope in zip((-1, 1), slopes, strict=True):
            most = max(case.largest(sign, 0.0), 0.0)
            if most < 1e8:
                assert most <= slope + 1e-9, seed
            if case.one_sign or case.limits.acceleration is None:
                assert min(slope, 1e8) == pytest.approx(min(most, 1e8), abs=1e-9), seed


def test_decays_are_the_best_that_hold_and_left_out_where_they_never_help():
    for seed in range(200):
        case = drawn(seed)
        low, high = case.span()
        courses = case.limits.courses(case.form, case.resting)
        falls, rises = (list(dict.fromkeys(laws)) for laws in zip(*courses, strict=True))
        assert courses == list(product(falls, rises))
        slopes = case.limits.slopes(case.form, case.resting)
        sides = (case.form.below, case.form.above)
        for sign, laws, slope, side in zip((-1, 1), (falls, rises), slopes, sides, strict=True):
            assert laws[0] == (slope, 0.0, False), seed
            for law in laws[1:]:
                assert case.largest(sign, law.decay) <= law.rate + 1e-9, seed
                assert law.rate == max(side, 0.0), seed
                more, less = (case.holds(sign, law.decay * by) for by in (1.01, 1 / 1.01))
                assert case.holds(sign, law.decay), seed
                assert (more, less) == (law.longest, not law.longest), seed
            # drag slows the sum down by the most that holds, or drives it on by the least
            tried = np.geomspace(1e-4, 1e4, 801)
            held = tried[case.holds(sign, tried)]
            slows = held.max() if held.size and not case.holds(sign, 1e9) else 0.0
            helps = case.one_sign and held.size > 0
            helps = helps and max(side, 0.0) - slows * max(high, -low) < slope
            assert len(laws) == 1 + helps, seed


def test_a_law_with_drag_that_says_no_more_is_left_out():
    """A fall of 1 that drag drives on, where accelerations allow no more than 1 either."""
    limits = Limits(period=1.0, length=(0.1, 9.0), rate=1.0, acceleration=1.0)
    own = ScaledLimits(GaitProblem(Worm(links=1, mass=1.0, drag=1.0), limits, Objective()))
    form = Form(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 1.0, np.inf)
    assert own.courses(form, (0,)) == [(Slope(1.0), Slope(1.0))]
