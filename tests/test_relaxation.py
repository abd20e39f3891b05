"""The relaxation row by row: what limits leave, boxes, cuts, and what a bound owes to what."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp
from scipy.interpolate import PPoly
from scipy.optimize import linprog
from test_certify import (
    G1_DURATIONS,
    G1_ORDER,
    ONE_CYCLE,
    WIDER,
    Making,
    Motion,
    box_around,
    coasting,
    extremes_as_limits,
    g1,
    least_of,
    motion_of,
    own_values,
    point,
)

from wormopt.numerics.linear_program import Maximum
from wormopt.systems.spiked.certify import cuts, relaxation
from wormopt.systems.spiked.certify.cuts import Cuts
from wormopt.systems.spiked.certify.relaxation import Relaxation
from wormopt.systems.spiked.programs.scaled_limits import ScaledLimits
from wormopt.systems.spiked.task import Worm


def left_by_limits(motion: Motion, program: Relaxation) -> np.ndarray:
    """What a motion leaves of its limits: at the ends of cells, on average, and over phases.

    Sorted, and times the share, duration or both of the phase, as rows of the program are.
    """
    limits, m, period, left = program._limits, program._cells, motion.period, []
    speed, way = limits.speed, motion.way
    swing = PPoly(-np.diff(way.c, axis=2), way.x)
    shortest, longest = np.array(limits.task.limits.length_ranges(limits.links)).T
    least = [least_of(PPoly(swing.c[:, :, j], swing.x)) for j in range(limits.links)]
    contraction, extension = limits.task.limits.rate_bounds(limits.links)
    for resting, start, stop in zip(motion.sequence, motion.edges, motion.edges[1:], strict=False):
        share, h, t = (stop - start) / period, stop - start, np.linspace(start, stop, m + 1)
        ends = np.vstack([motion.velocity(t[:-1]), motion.before(stop)])
        mean, gain = (
            np.diff(way(t), axis=0) * m / h,
            motion.before(stop) - motion.before(start or period),
        )
        rates = -np.diff(np.vstack([ends, mean]), axis=1)
        left += [share * (extension - rates) / speed, share * (contraction + rates) / speed]
        lengths = swing(t[:-1]) - least + shortest * WIDER
        left.append((longest - lengths) / period / speed)
        h, drag = h / limits.time, limits.drag * mean / speed
        for form in limits.forms(resting):
            force = np.diff(ends, axis=0) / speed * m / h @ form.alpha + drag @ form.beta
            left += [share * h * (form.above - force), share * h * (form.below + force)]
            if program._continuous:
                fall, rise = limits.slopes(form, resting)
                change, lost = gain @ form.alpha / speed, h * drag.mean(axis=0) @ form.beta
                left += [h * rise - change, h * fall + change]
                if limits.drag and form.beta.any():
                    left += [h * form.above - change - lost, h * form.below + change + lost]
    every = np.concatenate([np.ravel(each) for each in left])
    return np.sort(every[np.isfinite(every)])


@pytest.mark.parametrize(("drag", "jumps"), [(0.0, False), (0.7, False), (0.7, True)])
def test_rows_leave_what_the_motion_leaves_of_its_limits(drag, jumps):
    """Neither more nor less, of every limit; lengths close and all masses advance alike."""
    motion = motion_of(Making(shape=(3, 3), degree=2, knots=3, seed=5, jumps=jumps))
    worm = Worm(links=3, mass=(1.0, 2.0, 3.0, 0.5), drag=drag)
    task, _ = extremes_as_limits(motion, worm, 1.0, "equal", jumps)
    program = Relaxation(task, motion.sequence, 4)
    x = own_values(motion, program)
    program._set_box(program._tighten(np.array(box_around(motion, task, np.zeros(4)))))
    lp = program._program
    value = np.bincount(lp._row, lp._value * x[lp._column], len(lp._row_lower))
    given_ = np.isin(np.arange(len(value)), np.concatenate(program._plane_rows), invert=True)
    below, above = value - lp._row_lower, lp._row_upper - value
    one = given_ & (np.isinf(below) != np.isinf(above))
    left = np.sort(np.minimum(below, above)[one])
    assert left == pytest.approx(left_by_limits(motion, program), abs=1e-12)
    # lengths that close, 3 links; ways, 4 masses; shares and durations
    both = given_ & np.isfinite(below) & np.isfinite(above)
    assert np.count_nonzero(both) == 3 * 3 * 4 + 4 + 2
    assert np.count_nonzero(both | one) == np.count_nonzero(given_)
    assert np.abs(np.concatenate([below[both], above[both]])).max() <= 3e-14
    rounding = (lp._row_upper - lp._row_lower)[both]
    assert rounding[rounding != 0.0] == pytest.approx([2e-14] * 2, rel=0.1)


@pytest.mark.parametrize("jumps", [False, True])
def test_columns_are_there_where_masses_may_move(jumps):
    """Without jumps a mass that rests before a phase, or after it, begins or ends it at rest."""
    changed = {"acceleration": None, "impulses": True} if jumps else {}
    word = ((0,), (1, 3), (2,), (0, 1))
    program = Relaxation(g1(links=3, **changed), word, 3)
    for p, resting in enumerate(word):
        before, after = word[p - 1], word[(p + 1) % 4]
        for i in range(4):
            moves = i not in resting
            starts, stops = (moves and (jumps or i not in other) for other in (before, after))
            assert (program._y[p, :, i] >= 0).tolist() == [starts, moves, moves, stops]
            assert (program._q[p, :, i] >= 0).tolist() == [moves] * 3
            assert (program._c[p, i] >= 0) == (moves and i not in after)
        fastest, lp = program._limits.fastest(resting), program._program
        for columns in (program._q[p, 0], program._y[p, 1]):
            above = lp._upper[columns[columns >= 0]] / fastest[columns >= 0] - 1
            assert np.all((above > 1e-14) & (above < 1e-13))
    assert np.all(program._z < 0)


@settings(max_examples=examples(25), derandomize=True)
@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=3, max_size=3))
def test_boxes_are_drawn_in_to_shares_that_add_up_to_the_period(ends):
    """As far as linear programs say, and by a rounding less."""
    box = np.sort(np.array([*ends, (0.4, 0.7)]), axis=1)
    sides = Relaxation(g1(), G1_ORDER, 1)._tighten(box)
    assert (sides.a, sides.b) == (0.4, 0.7)
    if not box[:-1, 0].sum() + 1e-6 < 1.0 < box[:-1, 1].sum() - 1e-6:
        return
    for k, unit in enumerate(np.eye(3)):
        low, high = (
            sign * linprog(sign * unit, A_eq=np.ones((1, 3)), b_eq=[1.0], bounds=box[:-1]).fun
            for sign in (1, -1)
        )
        assert (sides.low[k], sides.high[k]) == pytest.approx((low, high), abs=1e-9)
        assert sides.low[k] == box[k, 0] or -2e-14 < sides.low[k] - exactly_left(box, k, 1) < -5e-15
        assert sides.high[k] == box[k, 1] or 5e-15 < sides.high[k] - exactly_left(box, k, 0) < 2e-14


def exactly_left(box: np.ndarray, k: int, end: int) -> float:
    """What others leave of 1 at one of their ends."""
    with mp.workdps(40):
        return float(1 - mp.fsum(mp.mpf(v) for v in np.delete(box[:-1, end], k)))


@pytest.mark.parametrize(
    ("swing", "a", "room"), [(0.2, 0.6, 1 / 0.6), (0.2, 0.0, 5.0), (1.9, 0.6, 1 / 1.9)]
)
def test_bounds_of_columns_are_those_of_the_box(swing, a, room):
    """In a box of which no side is beyond what the others allow."""
    program = Relaxation(g1(links=1, length=(0.1, 0.1 + swing)), ((0,), (1,)), 2)
    sides = program._tighten(np.array([(0.2, 0.5), (0.5, 0.8), (a, 0.9)]))
    program._set_box(sides)
    low, high = np.array([0.2, 0.5]), np.array([0.5, 0.8])
    lp, of = program._program, (program._e, program._h, program._g)
    for columns, least, most in zip(
        of, (low, low * a, low**2 * a), (high, high * 0.9, high**2 * 0.9), strict=True
    ):
        assert lp._lower[columns] == pytest.approx(least, abs=5e-14)
        assert lp._upper[columns] == pytest.approx(most, abs=5e-14)
    ends = [(lp._lower[k], lp._upper[k]) for k in (program._period, program._room)]
    assert np.array(ends) == pytest.approx(np.array([(a, 0.9), (0.0, room)]), rel=1e-13)
    assert min(lp._lower) >= 0.0
    for rows, plane in zip(program._plane_rows, program._planes, strict=True):
        side = np.broadcast_to(plane.of(sides.of(plane.phase))[1], rows.shape)
        assert np.all(np.abs(lp._row_upper[rows] - side - 1e-14) < 5e-15)


def test_cells_last_from_the_shortest_to_the_longest_of_the_box(monkeypatch):
    program, told = Relaxation(coasting()[0], ((0,), (1,)), 4), []
    monkeypatch.setattr(Cuts, "set_durations", lambda _, *durations: told.append(durations))
    program._set_box(program._tighten(np.array([(0.2, 0.5), (0.5, 0.8), (0.6, 0.9)])))
    ((shortest, longest),) = told
    assert shortest == pytest.approx(np.array([0.2, 0.5]) * 0.6 / 4, rel=1e-12)
    assert longest == pytest.approx(np.array([0.5, 0.8]) * 0.9 / 4, rel=1e-12)


@pytest.mark.parametrize("drag", [0.0, 1.0])
def test_cuts_are_made_where_they_are_missed_and_until_none_is(drag, monkeypatch):
    """Rows are broken by more than is asked, at first; in the end no shares of a cell are."""
    task = g1()
    task = replace(task, worm=replace(task.worm, drag=drag))
    program, cut_off, told = Relaxation(task, G1_ORDER, 3), Relaxation._cut_off, []

    def told_of(self: Relaxation, x: np.ndarray, missed: float) -> bool:
        lp, before = self._program, len(self._program._row_lower)
        more = cut_off(self, x, missed)
        value = np.bincount(lp._row, lp._value * x[lp._column], len(lp._row_lower))
        broken = (value - lp._row_upper)[before:]
        told.append(len(broken))
        assert more == bool(len(broken))
        assert np.all(broken > 0.9 * missed * x[self._way])
        return more

    monkeypatch.setattr(Relaxation, "_cut_off", told_of)
    program.solve((*((h - 0.02, h + 0.02) for h in G1_DURATIONS), ONE_CYCLE))
    assert told[0] > told[-1] == 0
    x = np.append(program._program.maximise().x, 0.0)
    own, width = program._cuts, 1.0 / 3
    grid = [(a, b) for a in np.linspace(0, 1, 11) for b in np.linspace(0, 1, 11) if a + b <= 1]
    before, after = np.array(grid).T
    for k, (p, weights) in enumerate(zip(own.phase, own.weights, strict=True)):
        if not np.isfinite(own.rise[k] + own.fall[k]):
            continue
        y, q, which = (
            x[program._y[p]] @ weights,
            x[program._q[p]] @ weights,
            np.full(len(before), k),
        )
        held, reach = own.holds(which, before, after), own.reach(which, before, after)
        level = (1 - before - after) * x[program._e[p]] * own.most[k]
        for cell in range(3):
            run = held[0] * y[cell] + held[1] * y[cell + 1] + reach * x[program._g[p]] * width / 2
            assert q[cell] <= np.min(run + level) + 2e-9


@pytest.mark.parametrize("links", [1, 2])
def test_cuts_are_those_of_the_box_wherever_they_were_made(links, monkeypatch):
    """Of sums that decay and others, in boxes of one gait and wide ones."""
    made, add = [], Relaxation._add_cuts
    monkeypatch.setattr(
        Relaxation, "_add_cuts", lambda self, *cuts: made.append(cuts) or add(self, *cuts)
    )
    worm = Worm(links=links, mass=1.0, drag=2.0, load=4.0)
    word = ((0,), (1,)) if links == 1 else G1_ORDER
    program = Relaxation(replace(g1(links=links), worm=worm), word, 3)
    shares = np.array([0.4, 0.35, 0.25] if links == 2 else [0.4, 0.6])
    boxes = [point(shares), point(shares[::-1]), (*((h - 0.1, h + 0.1) for h in shares), (0.5, 1))]
    for box in boxes:
        program.solve(box, 0.1)
    decay = np.concatenate([program._cuts.decaying[which] for which, *_ in made])
    assert decay.any()
    lp = program._program
    for box in boxes:
        program._set_box(program._tighten(np.array(box)))
        anew = [add(program, *cuts).assemble(len(lp._cost))[2] for cuts in made]
        stored = lp._value[lp._starts[-1 - len(decay)] :]
        assert stored == pytest.approx(np.concatenate(anew), rel=1e-14)


def test_the_loss_of_a_range_of_periods_is_what_it_costs_to_first_order():
    """Strokes want a shorter period, accelerations a longer one: 1.35 is best, and in the box."""
    program = Relaxation(g1(links=1, period=(1.0, 2.0)), ((0,), (1,)), 20)
    found = program.solve(((0.5, 0.5), (0.5, 0.5), (0.665, 0.685)))
    assert found.losses[:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert found.losses[2] == pytest.approx(found.bound - 4 / 9, rel=1e-3)
    t = found.point[2]
    assert found.slack == pytest.approx([0.0, 0.0, (t - 0.665) * (0.685 - t)], abs=1e-12)
    assert found.slack[2] > 9e-5
    wide = program.solve(((0.4, 0.55), (0.45, 0.6), (0.665, 0.685)))
    e, away = wide.point[:2], (np.array([0.4, 0.45]), np.array([0.55, 0.6]))
    assert wide.slack[:2] == pytest.approx((e - away[0]) * (away[1] - e), abs=1e-12)
    assert min(wide.slack[:2]) > 1e-4


@pytest.mark.parametrize("narrow", ["shares", "period"])
def test_products_cost_what_they_are_off_times_the_multipliers_of_their_planes(narrow):
    """To the side of the box that is to blame, from a point at which none is off."""
    motion = motion_of(Making(shape=(2, 3), degree=2, knots=3, seed=8))
    worm = Worm(links=2, mass=(1.0, 2.0, 3.0), drag=1.0)
    task, _ = extremes_as_limits(motion, worm, 1.0, "equal", jumps=False)
    program = Relaxation(task, motion.sequence, 2)
    x, random = own_values(motion, program), np.random.default_rng(0)
    duals, e, t = random.normal(size=program._rows.count), x[program._e], float(x[program._period])
    by, wide = (0.03, 0.0) if narrow == "period" else (0.0, 0.03), np.array([0.5, 1.0, 1.5])
    sides = cuts.Sides(e - by[0] * wide, e + by[0] * wide, t - by[1], t + by[1])

    def losses(column: int, off: float) -> np.ndarray:
        moved = x + off * (np.arange(len(x)) == column)
        return program._losses(Maximum(0.0, moved, duals), sides)

    # the largest square in the box is to be blamed on the share alone
    above = t * (by[0] * wide) ** 2
    x[program._g] += above
    pairs = list(zip(program._planes, program._plane_rows, strict=True))
    of = np.abs(duals[program._plane_rows[0]]) + np.abs(duals[program._plane_rows[1]])
    at_first = losses(-1, 0.0)
    assert at_first == pytest.approx(np.append(above * of, 0.0), abs=1e-12)

    meetings, drags, most = program._meeting, program._drag, 3
    cases = [(int(h), most, 1.0) for h in (*program._h, *program._g)]
    cases += [(int(program._room), most, t**2)]
    cases += [(int(y), int(p), 1.0) for p, y, *_ in zip(*meetings, strict=True)]
    cases += [
        (int(z), int(p) if narrow == "period" else most, 1.0)
        for p, z, *_ in zip(*drags, strict=True)
    ]
    for column, side, factor in cases:
        held = [
            np.abs(duals[rows][plane.columns[0 if column != program._room else 1] == column]).sum()
            for plane, rows in pairs
            if column != program._room or len(rows) == 1
        ]
        for off in (1e-3, -1e-3):
            expected = np.zeros(4)
            expected[side] = 1e-3 * factor * sum(held)
            assert losses(column, off) - at_first == pytest.approx(expected, abs=1e-12), column


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("drag", [0.0, 1.0])
def test_loads_are_multipliers_of_all_rows_times_what_others_bear_in_them(drag, slow, monkeypatch):
    """Found again as what a millionth less of those loads takes from rows, cuts among them.

    Where accelerations bound how fast velocities change, loads do not.
    """
    monkeypatch.setattr(relaxation, "scaled", ScaledLimits)
    most = {"rate": 10.0, "acceleration": 0.1 if slow else 2e3, "spike_load": (30.0, 9.0)}
    task = g1(links=1, sharing="least_actuation", **most)
    task = replace(task, worm=Worm(links=1, mass=20.0, drag=drag))
    made, add, forms = [], Relaxation._add_cuts, ScaledLimits.forms

    def relaxed():
        program = Relaxation(task, ((0,), (1,)), 3, (1, 1))
        program._set_box(program._tighten(np.array(((0.2, 0.5), (0.5, 0.8), (0.6, 0.9)))))
        return program

    program = relaxed()
    monkeypatch.setattr(
        Relaxation, "_add_cuts", lambda self, *cuts: made.append(cuts) or add(self, *cuts)
    )
    lp, random = program._program, np.random.default_rng(0)
    xs = random.uniform(size=(3, len(lp._cost)))
    assert all(program._cut_off(x, 1e-9) for x in xs)

    def less(*given_):
        return [replace(f, above=f.above - 1e-6 * f.shared) for f in forms(*given_)]

    monkeypatch.setattr(ScaledLimits, "forms", less)
    other = relaxed()
    for drawn in made:
        other._program.extend(add(other, *drawn))
    duals = random.normal(size=len(lp._row_lower))
    per_row = np.abs(duals[lp._row]) * xs[0, lp._column]
    gains = 1e6 * (other._program._value - lp._value) * per_row
    found = program._loads(Maximum(0.0, xs[0], duals))
    assert found == pytest.approx(gains.sum() * program._limits.speed, rel=1e-6)
    # cells' forces, gains of phases without and with drag, cuts of sums up and down
    changed = np.unique(lp._row[gains != 0.0])
    first = len(lp._row_lower) - sum(len(which) for which, *_ in made)
    assert np.count_nonzero(changed < first) == 2 * (3 + (not slow) + (drag > 0.0))
    up = np.concatenate([program._cuts.weights[which].sum(axis=1) > 0.0 for which, *_ in made])
    ways = set(up[changed[changed >= first] - first].tolist())
    assert ways == (set() if slow else {True, False})
    assert bool(program._cuts.decaying.any()) == (drag > 0.0)
    assert 0.0 < min(shared for *_, shared in program._borne) < (np.inf if slow else 1.0)


def test_bounds_are_rounded_up():
    """What is made of the linear program's, and one by the period, are no less than exact ones."""
    program = Relaxation(g1(links=2, rate=0.7), ((0,), (1,), (2,)), 2)
    for bound in np.random.default_rng(0).uniform(size=200).tolist():
        found = program._bound_of(Maximum(bound, np.empty(0), np.empty(0)))
        exact = Fraction(bound) * Fraction(float(program._limits.speed))
        assert exact <= Fraction(float(found)) <= exact * Fraction(1 + 1e-13)
        program._set_box(program._tighten(np.array([*3 * [(0.0, 1.0)], (0.9 + bound / 10, 1.0)])))
        exact = 1 / Fraction(0.9 + bound / 10)
        room = Fraction(program._program._upper[program._room].item())
        assert exact <= room <= exact * Fraction(1 + 1e-13)


def test_what_cuts_leave_to_the_largest_value_is_rounded_up():
    """By exact fractions of the shares that are no more than what they are as numbers."""
    program, random = Relaxation(g1(links=2), ((0,), (1,), (2,)), 2), np.random.default_rng(0)
    lp, cuts = program._program, program._cuts
    which = np.repeat(np.arange(len(cuts.most)), 20)
    before, after, _ = random.dirichlet((1, 1, 1), len(which)).T
    rows = lp.extend(program._add_cuts(which, 0 * which, before, after))
    for row, cut, b, a in zip(rows, which, before, after, strict=True):
        here = (lp._row == row) & (lp._column == program._e[cuts.phase[cut]])
        most = Fraction(cuts.most[cut])
        spare = Fraction(-lp._value[here].item()) - (1 - Fraction(b) - Fraction(a)) * most
        assert 0 <= spare <= Fraction(2e-14) * most


def test_a_single_cut_is_worth_another_round():
    """One is the first where averages are asked to be missed by less and less of any speed."""

    def told(speed: float) -> list[bool]:
        program, made = Relaxation(g1(links=2), ((0,), (1,), (2,)), 2), []
        program._set_box(program._tighten(np.array(point((0.3, 0.3, 0.4)))))
        add, lp = program._add_cuts, program._program
        x = speed * np.random.default_rng(0).uniform(size=len(lp._cost))
        program._add_cuts = lambda *cuts: made.append(len(cuts[0])) or add(*cuts)  # type: ignore[method-assign]
        found = [program._cut_off(x, missed) for missed in np.geomspace(1e3, 1e-6, 200)]
        assert made[0] == 1
        assert found == [False] * (200 - len(made)) + [True] * len(made)
        return found

    assert told(1.0) == told(3.0)


def test_cuts_are_worth_a_row_by_what_the_bound_is_above_the_cutoff():
    """Half of it, within a range of the speed; all of them without a cutoff, none below it."""
    program, told = Relaxation(g1(links=1), ((0,), (1,)), 2), []
    program._cut_off = lambda _, missed: told.append(missed)  # type: ignore[method-assign]
    box = point((0.5, 0.5))
    bound = program.solve(box).bound
    for above in (0.5, 1e-3, 1e-7, 0.0, -1e-3):
        program.solve(box, bound * (1 - above))
    assert told == pytest.approx([1e-9, 5e-3, 5e-4, 1e-5], rel=1e-6)


@pytest.mark.parametrize(
    "box", [((0.1, 0.2), (0.1, 0.2), (1.0, 1.0)), ((0.0, 1.0),) * 2 + ((0.9, 0.8),)]
)
def test_a_box_without_gaits_is_empty(box):
    found = Relaxation(g1(links=1), ((0,), (1,)), 2).solve(box)
    assert (found.bound, found.loads) == (-np.inf, 0.0)
    assert found.point.size == found.losses.size == found.slack.size == 0
