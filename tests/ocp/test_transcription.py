"""One transcription for any Model: exact optima, convergence, and bounds that hold inside arcs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from wormopt.model.friction import Coulomb
from wormopt.model.model import Model, Signal
from wormopt.model.modes import ModeSequence
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.mesh import Mesh, on_finer_mesh
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import finer
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.ocp.transcription import Transcription
from wormopt.systems.block.block import block

ROOT_ONE_AND_A_HALF = 1.224744871391589
BLOCK = block(Coulomb(1.0, 2.0), force=3.0)


def from_to(
    model: Model,
    start: tuple[float, ...],
    end: tuple[float, ...],
    cost: Callable[[Ends], ca.SX] = lambda ends: ends.duration,
    span: tuple[float, float] = (0.01, 10.0),
    **more: Any,
) -> Problem:
    """Shortest or cheapest transfer; as many states are given as start and end are long."""
    ends = Ends.of(model, int("integrands" in more))
    given = {"start": (ends.start, start), "end": (ends.end, end)}
    at_ends = [Constraint(n, all_[: len(v)], v, v) for n, (all_, v) in given.items() if v]
    return Problem(model, ends, cost(ends), span, boundary_constraints=at_ends, **more)


def integral(ends: Ends) -> ca.SX:
    return ends.integrals[0]


def solved(program: Transcription, modes: list[int], speed: float = 0.5):
    bounds = program.bounds(ModeSequence(tuple((m,) for m in modes)))
    w = program.rest(np.full(program.mesh.total, 0.5), np.array([0.0, speed]))
    return program.nlp.finish(program.nlp.solve(w, bounds, Ipopt()), bounds), bounds


def test_a_sticking_contact_does_not_move_and_its_force_stays_in_the_interval():
    # the sticking mode itself says that it starts at rest: only the position is given
    program = Transcription(
        from_to(BLOCK, (0.0,), (1.0, 0.0)), Mesh(2, 2, Collocation(3), input_degree=1)
    )
    solution, _ = solved(program, [0, 1])
    arcs = program.unpack(solution.w)
    assert np.abs(arcs.points[1][:, program.mesh.phase == 0]).max() < 1e-9
    assert np.all(arcs.unknowns[0][:, program.mesh.phase == 0] <= 2.0 + 1e-9)
    assert np.all(arcs.unknowns[0][:, program.mesh.phase == 0] >= -1.0 - 1e-9)
    assert solution.objective == pytest.approx(ROOT_ONE_AND_A_HALF, abs=1e-7)


def oscillator(scheme, degree: int, arcs: int) -> float:
    """Error of the cheapest swing of x'' = -x + u from 0 to (1, 0) in time 1, known in closed form.

    The optimal u is lambda' exp(A (1 - t)) B with the controllability Gramian G of (A, B), and
    the cost is half of x_f' G^{-1} x_f.
    """
    x, v, u = (ca.SX.sym(name) for name in "xvu")
    states = [Signal("position", x), Signal("velocity", v)]
    model = Model("oscillator", states, ca.vertcat(v, u - x), u=[Signal("drive", u)])
    problem = from_to(model, (0, 0), (1, 0), integral, (1.0, 1.0), integrands=u**2 / 2)
    mesh = Mesh.even(1, int(arcs), Collocation(degree, scheme), degree - 1)
    program = Transcription(problem, mesh)
    bounds = program.bounds(ModeSequence(((),)))
    w = program.rest(np.full(arcs, 1 / arcs), np.zeros(2))
    solution = program.nlp.solve(w, bounds, Ipopt(tolerance=1e-12))
    s2, c2 = np.sin(2.0), np.cos(2.0)
    gramian = np.array([[0.5 - s2 / 4, (1 - c2) / 4], [(1 - c2) / 4, 0.5 + s2 / 4]])
    exact = 0.5 * np.linalg.inv(gramian)[0, 0]
    return abs(solution.objective - exact)


@pytest.mark.parametrize(("scheme", "order", "most"), [("legendre", 4, 1e-4), ("radau", 3, 5e-4)])
def test_the_optimum_converges_at_the_order_of_the_scheme(scheme, order, most):
    arcs = np.array([2, 4, 8])
    errors = np.array([oscillator(scheme, 2, n) for n in arcs])
    slope = -np.polyfit(np.log(arcs), np.log(errors), 1)[0]
    assert order - 0.4 < slope < order + 0.7
    assert errors[-1] < most


@pytest.mark.parametrize("of_state", [False, True])
def test_bounds_hold_inside_arcs_not_only_at_nodes(of_state: bool):
    """A ball thrown up under a ceiling: with one arc the peak lies between all nodes."""
    y, v, u = (ca.SX.sym(name) for name in "yvu")
    top = 0.5 if of_state else np.inf
    states = [Signal("height", y, upper=top), Signal("speed", v)]
    model = Model("ball", states, ca.vertcat(v, u - 1), u=[Signal("gust", u, lower=0.0, upper=0.1)])
    under = [] if of_state else [Constraint("ceiling", y, upper=0.5)]
    problem = from_to(
        model, (0,), (0,), lambda ends: -ends.duration, (0.1, 10.0), path_constraints=under
    )
    program = Transcription(problem, Mesh(1, 4, Collocation(2)))
    bounds = program.bounds(ModeSequence(((),)))
    w = program.rest(np.full(4, 0.2), np.array([0.0, 0.5]))
    solution = program.nlp.finish(program.nlp.solve(w, bounds, Ipopt()), bounds)
    arcs = program.unpack(solution.w)
    s = np.linspace(0, 1, 201)[:, None] * arcs.duration
    height = arcs.start[0] + arcs.start[1] * s + (arcs.inputs[0, 0] - 1) * s**2 / 2
    assert height.max() <= 0.5 + 1e-9
    # The gust bears it up both ways: twice sqrt(2 * 0.5 / 0.9).
    assert arcs.duration.sum() == pytest.approx(2 * np.sqrt(1 / 0.9), abs=1e-6)


def test_refining_a_mesh_keeps_the_motion():
    problem = from_to(BLOCK, (0.0, 0.0), (1.0, 0.0))
    coarse = Transcription(problem, Mesh(1, 2, Collocation(2)))
    solution, _ = solved(coarse, [1])
    mesh = Mesh(1, 6, Collocation(5), input_degree=3)
    fine = Transcription(problem, mesh)
    bounds = fine.bounds(ModeSequence(((1,),)))
    carried = fine.nlp.start(
        fine.pack(on_finer_mesh(coarse.unpack(solution.w), coarse.mesh, mesh)), bounds
    )
    assert carried.violation < 1e-12
    assert carried.objective == pytest.approx(solution.objective, abs=1e-13)


def test_arcs_are_split_by_what_they_err_at_the_order_of_the_scheme():
    """Errors of arcs with two nodes fall with the cube of their number; five parts are the most."""
    mesh = Mesh(2, (2, 3), Collocation(2), 1, (0.4, 0.6, 0.2, 0.3, 0.5))
    split = finer(mesh, 1e-6 * np.array([0.0, 0.99, 7.9, 8.1, 1e6]), 1e-6)
    assert split.arcs == (2, 2 + 3 + 5)
    thirds = [0.4, 0.6, *[0.1] * 2, *[0.1] * 3, *[0.1] * 5]
    assert split.shares == pytest.approx(thirds, rel=1e-15)
    assert (split.phases, split.collocation, split.input_degree) == (2, mesh.collocation, 1)
    assert finer(mesh, np.full(5, 1e-6), 1e-6) == mesh
    with pytest.raises(ValueError, match="free duration"):
        finer(replace(mesh, shares=None), np.zeros(5), 1e-6)


def test_pack_is_the_inverse_of_unpack():
    program = Transcription(from_to(BLOCK, (0, 0), (1, 0)), Mesh(2, 3, Collocation(3), 1))
    w = np.random.default_rng(0).normal(size=len(program.rest(np.ones(6), np.zeros(2))))
    bounds = program.bounds(ModeSequence(((1,), (1,))))
    again = program.pack(program.unpack(w), bounds)
    arcs = len(w) - 3  # but for ends and duration, which follow from them
    assert again[:arcs] == pytest.approx(w[:arcs], abs=1e-14)
    assert again[arcs:] != pytest.approx(w[arcs:])
    assert program.pack(program.unpack(again), bounds) == pytest.approx(again, abs=1e-14)


def sized() -> Transcription:
    """Of a block whose position, velocity and time have nominal sizes other than 1."""
    states = [replace(s, nominal=size) for s, size in zip(BLOCK.x, (5.0, 0.2), strict=True)]
    problem = from_to(replace(BLOCK, x=states), (0.0, 0.0), (1.0, 0.0))
    mesh = Mesh(2, 2, Collocation(3), shares=(0.3, 0.7, 0.5, 0.5))
    return Transcription(replace(problem, duration=(4.0, 6.0)), mesh)


def test_a_worm_at_rest_rests_where_it_is_told_and_as_long():
    program, durations, start = sized(), np.array([1.0, 0.5, 2.0, 1.5]), np.array([7.0, 0.3])
    arcs = program.unpack(program.rest(durations, start))
    assert arcs.duration == pytest.approx(durations, rel=1e-14)
    assert arcs.start == pytest.approx(np.tile(start[:, None], 4), rel=1e-14)
    assert arcs.points == pytest.approx(np.tile(start[:, None, None], (1, 3, 4)), rel=1e-14)
    assert not arcs.inputs.any()


def test_guarded_durations_are_neither_negative_nor_above_the_longest():
    program = sized()
    bounds = program.bounds(ModeSequence(((1,), (-1,))))
    guarded = program.guarded(bounds)
    assert program.unpack(bounds.ubw).duration.tolist() == [6.0, np.inf, 6.0, np.inf]
    assert program.unpack(guarded.lbw).duration.tolist() == [0.0, 0.0, 0.0, 0.0]
    assert program.unpack(guarded.ubw).duration.tolist() == [6.0, 6.0, 6.0, 6.0]
    others = np.arange(len(bounds.lbw)) % program.arc.layout.size != 0
    assert np.array_equal(guarded.lbw[others], bounds.lbw[others])
    assert np.array_equal(guarded.ubw[others], bounds.ubw[others])


def drifting(shares: tuple[float, ...] | None) -> Transcription:
    """Two blocks that go at their own constant pace times 1 + t; both shall go as far."""
    x, v, t = ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("t")
    states = [Signal("position", x, nominal=5.0), Signal("velocity", v, nominal=0.2)]
    model = Model("blocks", x=states, ode=ca.vertcat(v * (1 + t), ca.SX(2, 1)), t=t)
    ends = Ends.of(model, 2)
    problem = Problem(
        model,
        ends,
        ends.duration + ends.integrals[0] + 10 * ends.integrals[1],
        (1.0, 3.0),
        periodic=["velocity"],
        displaced=["position"],
        integrands=ca.vertcat(t, v[0]),
    )
    return Transcription(problem, Mesh(2, (2, 3), Collocation(2), shares=shares))


@pytest.mark.parametrize("shares", [None, (0.3, 0.7, 0.5, 0.25, 0.25)])
def test_arcs_join_in_what_moves_and_nothing_else_fits(shares: tuple[float, ...] | None):
    program = drifting(shares)
    durations, pace = np.array([0.3, 0.7, 0.4, 0.2, 0.2]), 0.5
    begins = np.cumsum(durations) - durations

    def way(t: np.ndarray) -> np.ndarray:
        return pace * (t + t**2 / 2)

    rest = program.unpack(program.rest(durations, np.zeros(4)))
    places = begins + program.mesh.collocation.tau[:, None] * durations
    arcs = replace(
        rest,
        start=np.vstack([way(begins), 7 + way(begins), np.full((2, 5), pace)]),
        points=np.stack([way(places), 7 + way(places), *np.full((2, 2, 5), pace)]),
    )
    bounds = program.bounds(ModeSequence(((), ())))
    w = program.pack(arcs, bounds)
    assert program.nlp.violation(w, bounds) < 1e-14
    total = durations.sum()
    found = program.nlp.start(w, bounds).objective
    assert found == pytest.approx(total + total**2 / 2 + 10 * pace * total, rel=1e-14)
    # without the integrals, ends and total duration are written all the same
    ends = slice(-(4 + 1 + 2 * 5), -2 * 5)
    assert program.pack(arcs)[ends] == pytest.approx(w[ends], rel=1e-14)

    def wrong(**changed: np.ndarray) -> float:
        return program.nlp.violation(program.pack(replace(arcs, **changed), bounds), bounds)

    for state in (1, 3):  # one block goes farther, or its pace is not that of its way
        start, points = arcs.start.copy(), arcs.points.copy()
        start[state] *= 1.1
        points[state] *= 1.1
        assert wrong(start=start, points=points) > 1e-3
    for k in range(5):
        start = arcs.start.copy()
        start[:, k] += 0.1
        assert wrong(start=start) > 1e-3
        stretched = durations * np.where(np.arange(5) == k, 1.2, 1.0)
        assert wrong(duration=stretched) > 1e-3


def test_a_phase_keeps_the_shares_of_its_arcs():
    """A worm at rest in a model that knows no time: only the durations have to fit."""
    x = ca.SX.sym("x")
    model = Model("stone", x=[Signal("x", x)], ode=0 * x)
    problem = Problem(model, Ends.of(model), ca.SX(0), (1.0, 6.0))
    shares = (0.3, 0.7, 0.5, 0.25, 0.25)
    program = Transcription(problem, Mesh(2, (2, 3), Collocation(1), shares=shares))
    bounds = program.bounds(ModeSequence(((), ())))

    def violation(durations: np.ndarray) -> float:
        arcs = program.unpack(program.rest(durations, np.ones(1)))
        return program.nlp.violation(program.pack(arcs, bounds), bounds)

    fitting = np.array([0.3, 0.7, 1.0, 0.5, 0.5])
    assert violation(fitting) < 1e-15
    assert violation(fitting * [2, 2, 1, 1, 1]) < 1e-15  # each phase has its own duration
    assert violation(fitting * 3) > 0.1  # 9 are more than 6
    for k in range(5):
        assert violation(fitting * np.where(np.arange(5) == k, 1.2, 1.0)) > 1e-3


def test_what_rests_knows_the_time():
    """A worm at rest in a model that knows time: its clock has to fit as well."""
    x, v, t = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("t")
    states = [Signal("position", x), Signal("velocity", v)]
    model = Model("stone", x=states, ode=ca.vertcat(v * t, 0 * v), t=t)
    mesh = Mesh(2, (2, 3), Collocation(2))
    program = Transcription(Problem(model, Ends.of(model), ca.SX(0), (1.0, 6.0)), mesh)
    w = program.rest(np.array([0.3, 0.7, 0.4, 0.2, 0.9]), np.array([3.0, 0.0]))
    bounds = program.bounds(level=ModeSequence(((), ())))
    assert program.nlp.violation(w, bounds) < 1e-15
    for arc in range(5):
        late = w.copy()
        late[program.arc.layout.size * arc + program.arc.layout.clock.start] += 0.1
        assert program.nlp.violation(late, bounds) == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize("pace", [(1, 1, 1), (1, 1, 2), (1, 2, 1), (2, 1, 1), (2, 2, 1)])
def test_what_shall_move_as_far_moves_as_far(pace: tuple[float, ...]):
    """Three bodies, each at its own pace, and a fourth that has none to keep up with."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    states = [Signal("position", x, nominal=2.0), Signal("other", y)]
    model = Model("bodies", x=states, ode=ca.SX([*pace, 7.0]))
    problem = Problem(model, Ends.of(model), ca.SX(0), (1.0, 6.0))
    slopes, durations, rows = np.array([*pace, 7.0]), np.array([0.5, 0.7, 0.8]), []
    begins = np.cumsum(durations) - durations
    apart = np.ptp(pace) * durations.sum() / 2.0
    back = {"periodic": ["position"]}, max(pace) * durations.sum() / 2.0
    for ties, violation in (({}, 0.0), ({"displaced": ["position", "other"]}, apart), back):
        tied = replace(problem, **ties)
        program = Transcription(tied, Mesh(1, 3, Collocation(2)))
        places = begins + program.mesh.collocation.tau[:, None] * durations
        arcs = replace(
            program.unpack(program.rest(durations, np.zeros(4))),
            start=np.outer(slopes, begins),
            points=slopes[:, None, None] * places,
        )
        bounds = program.bounds(ModeSequence(((),)))
        found = program.nlp.violation(program.pack(arcs, bounds), bounds)
        assert found == pytest.approx(violation, abs=1e-13)
        rows.append(len(bounds.lbg))
    assert rows == [rows[0], rows[0] + 2, rows[0] + 3]


def test_limits_of_the_whole_count_in_nominal_sizes_of_their_own():
    """x' = q from 7 for 1.5, with q = 2: every limit is missed by a quarter of its nominal size."""
    x, q = ca.SX.sym("x"), ca.SX.sym("q")
    states, numbers = [Signal("x", x, nominal=5.0)], [Signal("q", q, value=9.0)]
    model = Model("cart", x=states, ode=q, p=numbers)
    ends, durations = Ends.of(model, 1), np.array([0.5, 1.0])
    start, end, duration, integral = ends.start, ends.end, ends.duration, ends.integrals[0]
    found = {start: 7.0, end: 10.0, duration: 1.5, integral: 12.75, q: 2.0}
    minimise = start + 10 * end + 100 * duration + 1000 * integral + 1e5 * q
    plain = Problem(model, ends, minimise, (1.0, 6.0), integrands=x, nominal=4.0)
    total = (7 + 100 + 150 + 12750 + 2e5) / 4.0
    for expression, value in (*found.items(), (start * q, 14.0)):
        for nominal in (0.5, 8.0):
            limit = Constraint("limit", expression, upper=value - nominal / 4, nominal=nominal)
            limited = replace(plain, boundary_constraints=[limit])
            program = Transcription(limited, Mesh(1, 2, Collocation(2)))
            bounds = program.bounds(ModeSequence(((),)), p={"q": 2.0})
            places = np.array([0.0, 0.5]) + program.mesh.collocation.tau[:, None] * durations
            arcs = replace(
                program.unpack(program.rest(durations, np.zeros(1))),
                start=np.array([[7.0, 8.0]]),
                points=7.0 + 2.0 * places[None],
            )
            w = program.pack(arcs, bounds)
            assert program.nlp.violation(w, bounds) == pytest.approx(0.25, rel=1e-12)
            assert program.nlp.start(w, bounds).objective == pytest.approx(total, rel=1e-14)


def test_what_is_held_are_durations_alone():
    program = drifting(None)
    for free in (2.0, np.inf):
        radius = program.hold_durations(free)
        assert not program.unpack(radius).duration.any()
        assert np.count_nonzero(radius == free) == len(radius) - program.mesh.total
    assert np.array_equal(program.hold_durations(), radius)


def test_nominal_sizes_are_what_a_variable_of_1_means():
    s = ca.SX.sym("s")
    problem = sized().problem
    design = [Signal("pace", ca.SX.sym("c"), lower=0.0, upper=20.0, nominal=10.0)]
    more = replace(problem, slacks=[Signal("worst", s, nominal=3.0)], design=design)
    program = Transcription(more, Mesh(1, 4, Collocation(3)))
    ones = program.unpack(np.ones(len(program.hold_durations())))
    extras = program.nominal_extras()
    assert np.array_equal(extras["slacks"], np.full((1, 3, 4), 3.0))
    assert np.array_equal(extras["slacks"], ones.slacks)
    assert extras["design"].tolist() == ones.design.tolist() == [10.0]
    extras["design"][0] = 0.0
    assert program.nominal_extras()["design"].tolist() == [10.0]
    assert ones.start.tolist() == [[5.0] * 4, [0.2] * 4]
    w = program.pack(ones)
    assert program.unpack(w).design.tolist() == [10.0]
    assert len(w) == len(program.hold_durations())


def test_states_have_their_rows():
    program = drifting(None)
    assert (program.rows_of("position"), program.rows_of("velocity")) == ([0, 1], [2, 3])
    with pytest.raises(ValueError, match="blocks has no state 'speed'"):
        program.rows_of("speed")


def test_rows_have_names_to_the_last():
    program = Transcription(from_to(BLOCK, (0.0, 0.0), (1.0, 0.0)), Mesh(2, 4, Collocation(2)))
    bounds = program.bounds(ModeSequence(((1,), (-1,))))
    names = [program.name_of(row) for row in range(len(bounds.lbg))]
    assert names[-4:] == ["start", "start", "end", "end"]
    assert [names.count("start"), names.count("end")] == [2, 2]
    # seven joints, and what ends and duration amount to
    assert names.count("continuity or the period") == 2 * 7 + 2 + 1
    assert names.count("a contact's mode") % 8 == 0


def test_a_constant_is_chosen_in_its_own_unit():
    """x' = c from 0 for a second: (x - 3)² + (c - 5)² is least where x = c = 4."""
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    pace = Signal("pace", c, lower=0.0, upper=20.0, nominal=10.0)
    model = Model("cart", x=[Signal("position", x)], ode=c, p=[pace])

    def cost(ends: Ends) -> ca.SX:
        return (ends.end - 3) ** 2 + (c - 5) ** 2

    problem = from_to(model, (0,), (), cost, (1.0, 1.0), design=[pace])
    program = Transcription(problem, Mesh(1, 2, Collocation(2)))
    w = program.rest(np.full(2, 0.5), np.zeros(1))
    solution = program.nlp.solve(w, program.bounds(ModeSequence(((),))), Ipopt())
    assert program.unpack(solution.w).design == pytest.approx([4.0], abs=1e-7)
    assert solution.objective == pytest.approx(2.0, abs=1e-12)


def test_wrong_number_of_phases_is_refused():
    program = Transcription(from_to(BLOCK, (0, 0), (1, 0)), Mesh(2, 1, Collocation(2)))
    with pytest.raises(ValueError, match="modes has 1 phases, but the mesh has 2"):
        program.bounds(ModeSequence(((1,),)))


def test_a_model_may_depend_on_time_and_have_algebraic_equations():
    """x' = z with z = cos(2 t): the end is sin(2 T)/2 whatever the input does."""
    x, t, z, u = (ca.SX.sym(name) for name in ("x", "t", "z", "u"))
    states, alg = [Signal("x", x)], z - ca.cos(2 * t)
    model = Model("clock", states, z, t=t, z=[Signal("z", z)], alg=alg, u=[Signal("u", u)])
    problem = from_to(model, (0,), (), integral, (1.5, 1.5), integrands=(u - z) ** 2)
    program = Transcription(problem, Mesh.even(1, 6, Collocation(5), input_degree=4))
    bounds = program.bounds(ModeSequence(((),)))
    w = program.rest(np.full(6, 0.25), np.zeros(1))
    arcs = program.unpack(program.nlp.solve(w, bounds, Ipopt()).w)
    end = arcs.start[0, -1] + (arcs.duration * (arcs.algebraic[0].T @ Collocation(5).B))[-1]
    assert end == pytest.approx(np.sin(3.0) / 2, abs=1e-9)
    assert arcs.inputs[0, 0, 0] == pytest.approx(1.0, abs=1e-4)
