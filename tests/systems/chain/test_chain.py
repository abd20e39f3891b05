"""The chain (8)-(12) against equations written by hand, Newton's laws and its energy balance."""

from collections.abc import Callable
from typing import Any, get_args

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from worms import worm

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Spike, Stribeck
from wormopt.model.given import fields_of
from wormopt.model.model import Model, pack
from wormopt.model.schedule import ParameterPath
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.loops import law_of
from wormopt.systems.chain.tables import Friction

seeds = st.integers(0, 10**6)


def drawn(model: Model, seed: int) -> dict[str, np.ndarray]:
    """Whole numbers for every symbol, masses powers of two: then arithmetic is exact."""
    random = np.random.default_rng(seed)
    signals = [*model.x, *model.u, *model.p]
    values = {s.name: random.integers(-9, 10, s.size).astype(float) for s in signals}
    values["force"] = random.integers(-9, 10, len(model.contacts)).astype(float)
    return values | {"mass": 2.0 ** random.integers(-2, 3, len(values["mass"]))}


def value(model: Model, expression: ca.SX, at: dict[str, np.ndarray]) -> np.ndarray:
    signals = [*model.x, *model.u, *model.p]
    symbols = [*(s.symbol for s in signals), model.forces]
    function = ca.Function("f", symbols, [expression])
    return np.array(function(*(at[s.name] for s in signals), at["force"])).ravel()


@given(links=st.integers(1, 8), seed=seeds)
def test_energy_changes_by_the_power_of_inputs_less_what_is_lost(links: int, seed: int):
    model = worm(links)
    at = drawn(model, seed)
    slope = value(model, ca.jtimes(model["energy"], pack(model.x), model.ode), at)[0]
    v, rate = at["velocity"], value(model, model["rate"], at)
    made = value(model, model["power"], at).sum() + at["force"] @ v
    lost = at["damping"] @ rate**2 + at["drag"] @ v**2 + at["load"] @ v
    assert slope == pytest.approx(made - lost, abs=1e-10)


@settings(max_examples=examples(25))
@given(seed=seeds)
def test_a_stiffness_that_varies_in_time_adds_its_own_power(seed: int):
    """With c(t) and nothing else, energy changes by c' (l - l0)^2 / 2, too."""
    random = np.random.default_rng(seed)
    path = ParameterPath(np.array([0.0, 1.0]), random.uniform(1, 2, (1, 2, 2)))
    model = chain(2, mass=1.5, stiffness=path, damping=0.0, rest_length=2.0)
    (schedule,) = model.schedules
    assert schedule.name == "stiffness"
    assert "stiffness" not in [p.name for p in model.p]
    energy, x = model["energy"], pack(model.x)
    slope = ca.jtimes(energy, x, model.ode) + ca.jacobian(energy, model.t)
    signals = [*model.x, *model.u, *model.p]
    symbols = [*(s.symbol for s in signals), schedule.symbol, schedule.begin, model.t]
    numbers = [random.uniform(-1, 1, 3), random.uniform(-1, 1, 3), np.zeros(2)]
    numbers += [np.array(p.value) for p in model.p]
    found = ca.Function("f", symbols, [slope])(*numbers, schedule.values[0], 0.0, 0.4)
    stretch = -np.diff(numbers[0]) - 2.0
    by_hand = path.coefficients[0, :, 1] @ stretch**2 / 2
    assert float(found) == pytest.approx(by_hand, abs=1e-12)


def test_the_chain_tells_what_it_is():
    model = chain(
        3,
        mass=[1.0, 2.0, 3.0, 4.0],
        stiffness=[10.0, 11.0, 12.0],
        damping=5.0,
        rest_length=[1.0, 2.0, 4.0],
        law=Coulomb(1.0, 10.0),
        drag=0.1,
        velocity=[0.0, 0.0, 0.0, -1.0],
        length_nominal=2.0,
        time_nominal=0.5,
    )
    assert [(s.name, s.value, s.unit, s.nominal) for s in (*model.x, *model.u)] == [
        ("position", (7.0, 6.0, 4.0, 0.0), "length", 2.0),
        ("velocity", (0.0, 0.0, 0.0, -1.0), "speed", 4.0),
        ("input", (0.0, 0.0, 0.0), "force", 2.5 * 8.0),
    ]
    assert {p.name: p.value for p in model.p} == {
        "mass": (1.0, 2.0, 3.0, 4.0),
        "drag": (0.1,) * 4,
        "load": (0.0,) * 4,
        "stiffness": (10.0, 11.0, 12.0),
        "damping": (5.0,) * 3,
        "rest_length": (1.0, 2.0, 4.0),
        "friction_forward": (1.0,) * 4,
        "friction_backward": (10.0,) * 4,
    }
    assert [c.name for c in model.contacts] == [f"mass {i}" for i in range(4)]
    for i, contact in enumerate(model.contacts):
        assert ca.is_equal(contact.velocity, model.x[1].symbol[i])
        assert contact.force.is_symbolic()
    delassus = ca.evalf(ca.substitute(model.delassus, model.p[0].symbol, [1.0, 2.0, 4.0, 8.0]))
    assert np.array_equal(delassus.full(), np.diag([1.0, 0.5, 0.25, 0.125]))
    assert worm(2, position=(0, 2, 4)).x[0].value == (0.0, 2.0, 4.0)
    steps = ParameterPath(np.array([0.0, 1.0]), np.array([[[1.5], [2.5]]]))
    assert worm(2, rest_length=steps).x[0].value == (4.0, 2.5, 0.0)


def test_without_friction_there_are_no_contacts():
    model = worm(2, law=None)
    assert (len(model.contacts), model.forces.shape, model.schedules) == (0, (0, 1), [])
    assert all(not p.name.startswith("friction") for p in model.p)


def test_each_mass_may_have_its_own_law():
    laws = [Coulomb(1.0, 2.0), Spike(3.0), Stribeck(0.5, 0.6, 0.7, 0.8, 0.1)]
    model = worm(2, law=laws)
    assert {p.name: (p.value, p.unit) for p in model.p if p.name.startswith("friction")} == {
        "friction_forward": ((1.0, 0.5), "force"),
        "friction_backward": ((2.0, 0.6), "force"),
        "friction_scale": ((3.0,), "force"),
        "friction_stick_forward": ((0.7,), "force"),
        "friction_stick_backward": ((0.8,), "force"),
        "friction_v_stribeck": ((0.1,), "speed"),
    }
    for contact, law in zip(model.contacts, laws, strict=True):
        assert type(contact.law) is type(law)


def instructions(links: int) -> int:
    model = worm(links)
    outputs = [o.expression for o in model.outputs]
    symbols = [pack(model.x), pack(model.u), pack(model.p), model.forces]
    return ca.Function("f", symbols, [model.ode, *outputs]).n_instructions()


@pytest.mark.parametrize("table", get_args(Friction))
def test_every_friction_table_makes_a_law_with_its_numbers(table: Any):
    numbers = {name: k + 1.0 for k, name in enumerate(table.__struct_fields__)}
    law = law_of(table(**numbers))
    assert fields_of(law) == numbers


def test_work_grows_linearly_with_the_links():
    counts = np.array([instructions(n) for n in (250, 500, 1000)])
    assert counts[2] - counts[1] == 2 * (counts[1] - counts[0])
    assert counts[2] < 100 * 1000


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: worm(0), "not a positive integer; write at least 1"),
        (lambda: worm(2, mass=0.0), "mass must be positive"),
        (lambda: worm(2, mass=[1.0, 2.0]), "mass must be one number or 3"),
        (lambda: worm(2, stiffness=-1.0), "stiffness must be 0 or above, not -1"),
        (lambda: worm(2, position=[0.0, 1.0]), "position must be one number or 3"),
        (lambda: worm(2, law="coulomb"), "law contains 'coulomb', which is not a friction law"),  # type: ignore[arg-type]
        (lambda: worm(2, law=[Spike()]), "law has 1 entries; give one law, or 3"),
        (
            lambda: worm(2, damping=ParameterPath(np.array([0.0, 1.0]), np.ones((1, 3, 1)))),
            "path of damping has 3 parameters for 2 links",
        ),
    ],
)
def test_chains_that_make_no_sense_are_refused(build: Callable[[], Model], message: str):
    with pytest.raises(ArgumentError, match=message):
        build()
