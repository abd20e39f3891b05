"""Constructors and names: what does not fit is refused where it is written, by its name."""

import re
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError, UnknownNameError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Output, Signal, Switch
from wormopt.model.schedule import Delay, Schedule
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.optimise import Optimum, optimise
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.quantities import UNITS
from wormopt.result import Result, Scalar

q, v, u, f, s = (ca.SX.sym(name) for name in ("q", "v", "u", "f", "s"))
stray = ca.SX.sym("stray", 2)
WRONG: Any = "a word"
STEPS = np.array([0.0, 1.0])
CART = Model(
    "cart",
    x=[Signal("position", q), Signal("velocity", v)],
    ode=ca.vertcat(v, u),
    u=[Signal("force", u, lower=-1.0, upper=1.0)],
)
ENDS = Ends.of(CART, 1)
RULE = Collocation(3)
START = Constraint("start", ENDS.start, 0.0, 0.0)


def untyped(value: Any) -> Any:
    return value


def model(**changes: Any) -> Model:
    return replace(CART, **changes)


def problem(*at_ends: Constraint, **changes: Any) -> Problem:
    return replace(
        Problem(CART, ENDS, ENDS.duration, (0.1, 10.0)), boundary_constraints=at_ends, **changes
    )


def solved(task: Problem) -> Optimum:
    guess = Guess(2.0, lambda t: np.vstack([t / 2, 0 * t + 0.5]))
    return optimise(task, Mesh.even(1, 6, Collocation(3)), FixedModes(), guess)


# -- symbols that belong to nothing ----------------------------------------------------------------

CONTACT = Contact("sole", v, f, Coulomb(1.0, 2.0))


@pytest.mark.parametrize(
    ("where", "made"),
    [
        ("ode", lambda: model(ode=ca.vertcat(v, stray[0]))),
        ("ode", lambda: Model("m", x=[Signal("position", q)], ode=f)),
        ("alg", lambda: model(z=[Signal("z", s)], alg=s - stray[1])),
        ("output way", lambda: model(outputs=[Output("way", q * stray)])),
        ("velocity of contact", lambda: model(contacts=[replace(CONTACT, velocity=v + stray[0])])),
        ("guard of switch", lambda: model(switches=[Switch("stop", stray[0], CART.ode)])),
        ("reset of switch", lambda: model(switches=[Switch("stop", q, stray)])),
        ("signal of delay", lambda: model(delays=[Delay("past", s, q * stray[0], 1.0)])),
        ("lag of delay", lambda: model(delays=[Delay("past", s, q, stray[0])])),
        ("integrands", lambda: problem(integrands=(q - stray[0]) ** 2)),
        ("path constraint 'room'", lambda: problem(path_constraints=[Constraint("room", stray)])),
        ("minimise", lambda: problem(minimise=stray[0])),
        ("boundary constraint 'way'", lambda: problem(Constraint("way", ENDS.end - stray))),
    ],
)
def test_expressions_with_symbols_of_nothing_are_named(where: str, made: Callable[[], Any]):
    with pytest.raises(ArgumentError, match=rf"{re.escape(where)}.*(stray|: f;)"):
        made()


@pytest.mark.parametrize("where", ["integrands", "path_constraints"])
def test_a_reference_needs_its_schedule_in_the_model(where: str):
    gait = wo.Gait(np.array([0.0, 1.0, 2.0]), np.array([[[1.0, 0.5]], [[1.5, -0.5]]]))
    reference = wo.gait_reference(gait, CART.t)
    off = (q - reference.value) ** 2
    part = {where: off if where == "integrands" else [Constraint("near", off, upper=1.0)]}
    with pytest.raises(ArgumentError, match=r"reference_.*schedules=\[\*model.schedules"):
        problem(**part)
    known = model(schedules=[*CART.schedules, *reference.schedules])
    assert problem(model=known, **part).model is known


def test_a_constant_of_design_is_a_parameter_that_has_no_value_of_its_own():
    ratio = Signal("ratio", ca.SX.sym("ratio"), lower=0.5, upper=2.0)
    driven = model(ode=ca.vertcat(v, ratio.symbol * u), p=[ratio, Signal("mass", s, value=1.0)])
    assert [p.name for p in problem(model=driven, design=[ratio]).parameters] == ["mass"]
    assert [p.name for p in problem(model=driven).parameters] == ["ratio", "mass"]


def test_symbols_and_what_holds_them_are_replaced_together():
    ode, mass = ca.vertcat(v, u / s), Signal("mass", s, value=2.0)
    with pytest.raises(
        ArgumentError, match=r"to none of its parts: s; .*replace them and the expressions together"
    ):
        replace(CART, ode=ode)
    assert replace(CART, ode=ode, p=[mass]).p == [mass]


@pytest.mark.parametrize(
    "made",
    [
        lambda: model(p=[Signal("mass", q)]),
        lambda: model(contacts=[CONTACT, replace(CONTACT, name="other")]),
        lambda: model(p=[Signal("mass", stray), Signal("more", stray)]),
    ],
)
def test_a_symbol_has_one_owner(made: Callable[[], Any]):
    with pytest.raises(ArgumentError, match="belongs to two of its parts"):
        made()


# -- arguments against each other ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: Signal("lengths", ca.SX.sym("l", 3), value=[1, 2]), "s has 3 entries, not 2"),
        (lambda: Signal("way", q, lower=2.0, upper=1.0), "way: lower 2.0 is above upper 1.0"),
        (lambda: Signal("way", q, nominal=0.0), "way: nominal must be positive"),
        (lambda: Signal("way", 2 * q), "way: symbol must be a column of symbols"),
        (lambda: Signal("way", q, unit="m"), "unit of 'way' is 'm'; did you mean 'length'"),
        (lambda: Signal("way", q, unit="m s-1"), "'m s-1'; did you mean 'speed'"),
        (lambda: Signal("way", q, unit="lenght"), "'lenght'; did you mean 'length'"),
        (lambda: Signal("way", q, unit="furlongs"), "'furlongs'; write a quantity"),
        (lambda: Output("way", q, "N"), "unit of 'way' is 'N'; did you mean 'force'"),
        (lambda: replace(CONTACT, nominal_force=-1.0), "contact sole: nominal_force must be"),
        (lambda: replace(CONTACT, force=2 * f), "contact sole: force must be a column of symbols"),
        (lambda: Switch("stop", stray, q), "switch stop: guard must be a scalar"),
        (lambda: Schedule("push", s, q, STEPS[:1], STEPS[1:]), "schedule push: breaks must ascend"),
        (lambda: Constraint("force", u, 1, -1), "'force': lower 1 is above upper -1"),
        (lambda: Constraint("ends", stray, [0, 2], [1, 1]), "'ends': lower 2 .* 1 in row 1"),
        (lambda: Constraint("force", u, np.nan), "'force': there is no number between nan and inf"),
        (lambda: Constraint("force", u, upper=-np.inf), "'force': there is no number between"),
        (lambda: Constraint("force", u, nominal=0.0), "'force': nominal must be positive"),
        (lambda: Signal("way", q, upper=untyped([0.0, 1.0])), "signal way: upper must be a"),
        (lambda: Signal("ways", stray, value=untyped([[1.0, 2.0]])), r"value of ways has 2"),
        (lambda: Signal("ways", ca.SX.sym("w", 4), value=untyped(np.eye(2))), "value of ways has"),
        (lambda: Signal("way", q, lower=0.0, value=-1.0), "way must be 0 or above, not -1"),
        (lambda: Signal("ways", stray.T), "signal ways: symbol must be a column of symbols"),
        (lambda: Output("ways", stray.T), "output ways: expression must be a column"),
        (lambda: replace(CONTACT, law=Coulomb), "sole: law must be .* not the class Coul"),
        (lambda: model(contacts=[replace(CONTACT, velocity=v + f)]), "velocity depends on con"),
        (lambda: model(switches=[Switch("stop", q, CART.ode.T)]), "switch stop: reset must be a"),
        (lambda: model(switches=[Switch("stop", q, q)]), "switch stop: reset must be a column of"),
        (lambda: model(ode=CART.ode.T), "model cart: ode must be a column of 2"),
        (lambda: model(t=ca.SX.sym("t", 2)), "model cart: t must be a scalar symbol"),
        (lambda: model(outputs=2 * [Output("way", q)]), "outputs share the name '(way|position)'"),
        (lambda: model(outputs=[Output("position", v)]), "outputs share the name '(way|position)'"),
        (lambda: model(contacts=[CONTACT, replace(CONTACT, force=s)]), "s share the name 'sole'"),
        (lambda: model(switches=2 * [Switch("stop", q, CART.ode)]), "share the name 'stop'"),
        (lambda: Schedule("push", s, q + 1, STEPS, STEPS[1:, None]), "schedule push: begin must"),
        (lambda: Schedule("push", s.T * 2, q, STEPS, STEPS[1:, None]), "symbol must be a colum"),
        (lambda: Schedule("push", s, q, STEPS, STEPS[1:, None], start=np.nan), ".* nan"),
        (lambda: wo.Tolerance(max_steps=untyped(1.5)), "max_steps must be a whole .* not 1.5"),
        (lambda: wo.simulate(CART, 1.0, dense=WRONG), "dense must be True or False"),
        (lambda: wo.simulate(CART, untyped("3")), "span must be a number or a list of numbers,"),
        (lambda: Constraint("ways", ca.horzcat(q, v)), "'ways': expression must be a column"),
        (lambda: problem(duration=2.0), r"duration must be a positive range .*, not 2\.0"),
        (lambda: problem(duration=(1.0, np.inf)), "duration must be a positive range"),
        (lambda: problem(minimise=1.0), r"minimise must be an expression .* as ends\.duration,"),
        (lambda: problem(minimise=ENDS.end), "minimise must be a scalar"),
        (lambda: problem(minimise=ENDS.integrals[0]), r"0 integrands, but ends with 1 integrals;"),
        (lambda: problem(ends=Ends.of(replace(CART, x=CART.x[:1], ode=u))), "ends have 1 states"),
        (lambda: Ends.of(CART, -1), "n_integrals must be a whole number, 0 or above, not -1"),
        (lambda: Guess(-1.0, np.sin), r"duration must be finite and above 0, not -1\.0"),
        (lambda: Guess(1.0, np.sin, phases=np.array([-1.0])), "phases must be a list of durations"),
        (lambda: Mesh(0, 1, RULE), "phases must be a whole number, 1 or above, not 0"),
        (lambda: Mesh(1, untyped(1.5), RULE), r"arcs must be a whole number, 1 or above, not 1\.5"),
        (lambda: Mesh.even(2, [1, 2, 3], RULE), "arcs has 3 entries for 2 phases"),
        (lambda: Mesh(1, 2, RULE, -1), "input_degree must be a whole number, 0"),
        (lambda: Mesh(1, 2, RULE, 0, (1.0, 1.0)), "shares must be positive numbers, .* with sum"),
        (lambda: Mesh.over([0.0, np.inf], 1.0, RULE), "breaks must ascend and be finite"),
        (lambda: Mesh.over([0.0, 1.0], 1e-300, RULE), "longest is 1e-300 over a span of 1: more"),
        (lambda: Collocation(untyped(2.5)), r"degree must be a whole number, 1 or above, not 2\.5"),
        (lambda: wo.ModeSequence(untyped((0, 1))), "phases must be lists of the states of all"),
        (lambda: wo.ModeSequence.of_resting(untyped([0, 1]), 3), "resting contacts must be sets"),
        (lambda: wo.MoreauJean(WRONG), "model must be of type Model, not 'a word'"),
        (lambda: wo.Complementarity(ratio=1.0), "ratio must be below 1"),
        (lambda: Coulomb(stray, 2.0), "forward must be a number, not SX"),
        (lambda: problem(duration=(2.0, 1.0)), "duration must be a positive range"),
        (lambda: problem(periodic=["positon"]), "no state 'positon'.*did you mean 'position'"),
        (lambda: problem(design=[u]), "design"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_name(made: Callable[[], Any], told: str):
    with pytest.raises(ArgumentError, match=told):
        made()


MADE = [
    Signal("way", q), Output("way", q), CONTACT, Switch("stop", q, q), Delay("past", s, q, 1.0),
    Schedule("push", s, f, STEPS, STEPS[1:, None]), START, CART, problem(), Mesh(1, 1, RULE), RULE,
    Guess(1.0, np.sin), FixedModes(), wo.Tolerance(), wo.Smooth(), wo.Regularised(),
    wo.Complementarity(), Coulomb(1.0, 2.0), wo.Elliptic(1.0, 1.0, 1.0), wo.Viscous(1.0),
    wo.Stribeck(1.0, 2.0, 2.0, 3.0, 0.1), wo.Spike(), wo.ModeSequence(((0, 1),)),
]  # fmt: skip
LATER = {"spans", "active"}  # made by the package itself


@pytest.mark.parametrize(
    ("one", "name"),
    [(one, field.name) for one in MADE for field in fields(one) if field.name not in LATER],
    ids=lambda part: part if isinstance(part, str) else type(part).__name__,
)
def test_every_argument_refuses_by_its_name_what_it_is_not(one: Any, name: str):
    for wrong in (object(), *([] if name == "name" else [WRONG])):
        with pytest.raises(ArgumentError, match=rf"{name}|no state '{WRONG}'"):
            replace(one, **{name: wrong})


def test_what_is_made_stays_what_it_is():
    made: list[Any] = [part for name in wo.__all__ if is_dataclass(part := getattr(wo, name))]
    assert len(made) > 70
    assert [part for part in made if not part.__dataclass_params__.frozen] == []


@pytest.mark.parametrize("unit", [*UNITS, "1", "rad", "s", "kg m2", "K"])
def test_quantities_and_units_that_no_quantity_has_are_taken(unit: str):
    assert Signal("way", q, unit=unit).unit == unit


@pytest.mark.parametrize("seed", range(20))
def test_values_have_one_entry_or_all(seed: int):
    random = np.random.default_rng(seed)
    size, given = random.integers(1, 6, 2).tolist()
    symbol, value = ca.SX.sym("l", size), random.normal(size=given).tolist()
    if given in (1, size):
        assert Signal("lengths", symbol, value=value).size == size
        return
    with pytest.raises(ArgumentError, match=f"lengths has {size} entr(y|ies), not {given}"):
        Signal("lengths", symbol, value=value)


# -- limits that contradict each other -------------------------------------------------------------


def at_end(name: str, row: int, low: float, high: float) -> Constraint:
    return Constraint(name, ENDS.end[row], low, high)


MOVED = Constraint("way", ENDS.end - ENDS.start, [3, -9], [3, 9])


@pytest.mark.parametrize(
    ("at_ends", "changes", "named"),
    [
        ([at_end("target", 0, 1, 1), at_end("goal", 0, 2, 2)], {}, {"target", "goal"}),
        ([at_end("far", 0, 1, np.inf)], {"periodic": ["position"]}, {"far", "periodic position"}),
        ([MOVED, at_end("near", 0, -1, 2)], {}, {"way", "near"}),
    ],
)
def test_contradictions_of_the_ends_are_named(at_ends, changes: dict, named: set[str]):
    rest = at_end("rest", 1, 0, 0)
    with pytest.raises(ArgumentError, match="constraint") as refused:
        problem(START, rest, *at_ends, **changes)
    found = set(re.findall("'([^']+)'", str(refused.value)))
    assert named <= found <= named | {"start"}


@pytest.mark.parametrize("seed", range(20))
def test_two_intervals_of_one_end_contradict_each_other_only_if_they_are_apart(seed: int):
    random = np.random.default_rng(seed)
    size = 10 ** random.uniform(-3, 3)
    (a, b), (c, d) = np.sort(size * random.normal(size=(2, 2))).tolist()
    one = Constraint("one", ENDS.end[0] / size, a / size, b / size)
    other = Constraint("other", 2 * ENDS.end[0], 2 * c, 2 * d, nominal=size)
    if max(a, c) <= min(b, d):
        assert len(problem(START, one, other).boundary_constraints) == 3
        return
    with pytest.raises(ArgumentError, match="'one' and 'other' contradict each other"):
        problem(START, one, other)


@pytest.mark.parametrize(
    ("at_ends", "along", "named"),
    [
        ([Constraint("square", ENDS.end[0] ** 2, 4, 4), at_end("way", 0, 1, 1)], [], "way|square"),
        ([at_end("way", 0, 1, 1)], [Constraint("still", v, 0, 0)], "still|way"),
    ],
)
def test_equalities_that_contradict_each_other_otherwise_are_named(at_ends, along, named: str):
    with pytest.raises(SolveError, match=rf"allows one is ({named}) by") as refused:
        solved(problem(START, *at_ends, path_constraints=along))
    assert refused.value.code == "infeasible"


def test_numbers_of_numpy_and_casadi_are_numbers():
    law = Coulomb(untyped(np.array(1.0)), 2)
    assert law == Coulomb(1.0, 2.0)
    assert hash(law) == hash(Coulomb(1.0, 2.0))
    assert Signal("way", q, nominal=untyped(np.array(2.0)), lower=untyped(np.array(0.0))).lower == 0
    assert Signal("ways", stray, value=untyped(ca.DM([1.0, 2.0]))).value == (1.0, 2.0)
    tolerance = wo.Tolerance(max_steps=untyped(1e4))
    assert tolerance.max_steps == 10_000
    assert wo.simulate(CART, 1.0, tolerance=tolerance).end.tolist() == [0, 0]
    assert Mesh(2, [1, 2], RULE, shares=[1.0, 0.25, 0.75]).total == 3
    assert wo.ModeSequence(untyped([[0, 1], np.array([1, 0])])).phases == ((0, 1), (1, 0))


# -- names -----------------------------------------------------------------------------------------


def test_american_names_are_the_british_ones():
    for name in ("optimize", "linearize", "Regularized", "optimize_switching_times"):
        assert getattr(wo, name) is getattr(wo, name.replace("iz", "is"))


@pytest.mark.parametrize(
    ("name", "meant"), [("simulte", "simulate"), ("Sgnal", "Signal"), ("chian", "chain")]
)
def test_misspelt_names_of_the_package_have_a_hint(name: str, meant: str):
    with pytest.raises(AttributeError, match=f"no attribute '{name}'; did you mean '{meant}'"):
        getattr(wo, name)


@pytest.mark.parametrize(("old", "new"), [("recede", "run_mpc"), ("Doubt", "NonsmoothEvent")])
def test_former_names_of_the_package_say_the_new_ones(old: str, new: str):
    with pytest.raises(AttributeError, match=f"no attribute '{old}'; it is now called '{new}'"):
        getattr(wo, old)


def test_names_that_are_like_none_have_no_hint():
    with pytest.raises(AttributeError, match=r"no attribute 'zzzz'$"):
        getattr(wo, "zzzz")  # noqa: B009
    assert not hasattr(wo, "__wrapped__")


def test_misspelt_scalars_states_and_parameters_have_a_hint():
    result = Result("walk", "gait", scalars={"speed": Scalar(0.5), "advance": Scalar(1.0)})
    with pytest.raises(KeyError) as error:
        result.scalars["sped"]
    assert "; did you mean 'speed'? It has 'speed'" in str(error.value)
    worm = wo.chain(1, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0)
    wrong: list[dict[str, Any]] = [{"p": {"mas": 1.0}}, {"x0": {"postion": 0.0}}]
    for given in wrong:
        with pytest.raises(UnknownNameError, match=r"did you mean '(mass|position)'"):
            wo.simulate(worm, 1.0, **given)


def test_numbers_of_laws_may_become_parameters_later():
    law = Coulomb(stray[0], 2.0)
    grips, outputs = [replace(CONTACT, law=law)], [Output("grip", stray[0])]
    early = model(contacts=grips, outputs=outputs, ode=CART.ode + f)
    late = replace(early, p=[Signal("grips", stray, value=1.0)])
    assert late.n_x == 2
    named = "forward of the law of contact sole holds .*: stray_0; add Signal"
    solves: list[Callable[[], object]] = [
        lambda: wo.simulate(early, 1.0),
        lambda: wo.linearise(early, output="grip"),
        lambda: solved(replace(problem(START), model=early)),
    ]
    for solve in solves:
        with pytest.raises(ArgumentError, match=named):
            solve()


def test_schedules_of_a_model_own_their_symbols():
    begin, c = ca.SX.sym("begin"), ca.SX.sym("c")
    steps = Schedule("push", c, begin, np.array([0.0, 1.0]), np.array([[2.0]]))
    assert model(ode=ca.vertcat(v, c * (CART.t - begin) + u), schedules=[steps]).n_x == 2
