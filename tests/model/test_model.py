"""The Model and the spiked worm as one, against the closed-form crawl and Newton's laws."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wormopt.errors import ArgumentError
from wormopt.model.friction import Spike, Viscous
from wormopt.model.gait import Gait
from wormopt.model.model import TINY, Contact, Model, Output, Signal, pack
from wormopt.model.schedule import Schedule
from wormopt.systems.spiked.construct import block_wave, fast_gait
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.dynamics import spiked_worm

masses = st.lists(st.floats(0.1, 5), min_size=2, max_size=9)


def functions(model: Model) -> ca.Function:
    """ode, contact velocities and accelerations and outputs from states, inputs and forces."""
    outputs = [o.expression for o in model.outputs]
    return ca.Function(
        "model",
        [pack(model.x), pack(model.u), model.forces],
        [model.ode, model.contact_velocities, model.contact_accelerations, *outputs],
    )


@given(mass=masses, drag=st.floats(0, 3), load=st.floats(0, 9))
def test_a_force_on_any_mass_moves_the_rigidly_driven_chain_as_one(
    mass: list[float], drag: float, load: float
):
    """With prescribed link accelerations every force accelerates all masses by force / sum m."""
    model = spiked_worm(mass, drag, load)
    delassus = ca.evalf(model.delassus)
    count = len(mass)
    assert np.array(delassus) == pytest.approx(np.full((count, count), 1 / sum(mass)))


@pytest.mark.parametrize(
    ("gait", "mass", "drag", "load"),
    [
        (fast_gait(1.0), [1.0, 1.0, 1.0], 1.0, 20.0),
        (fast_gait(1.0), [1.0, 2.0, 0.5], 0.7, 8.0),  # glides
        (block_wave(4, 2, 1.3, (0.9, 1.2), "quintic"), [1.0, 0.4, 2.0, 1.1, 0.7], 0.0, 30.0),
        (block_wave(1, 1, 0.8, (0.9, 1.2), "trapezoid"), [1.0, 3.0], 2.0, 4.0),
    ],
)
def test_the_symbolic_worm_moves_as_the_closed_form_crawl(
    gait: Gait, mass: list[float], drag: float, load: float
):
    """The crawl's links and loads put into the model give the crawl's accelerations and forces.

    Accelerations of the crawl are slopes of its velocities, found by central differences.
    """
    motion = crawl(gait, mass, drag, load, "least_actuation")
    model = functions(spiked_worm(mass, drag, load))
    n, checked = gait.links, 0
    for stretch in motion.stretches:
        if stretch.stop - stretch.start < 0.02:
            continue
        rows = motion._rows
        h = 1e-4
        middle = np.linspace(stretch.start + 0.005, stretch.stop - 0.005, 7)
        now, ahead, behind = (motion.quantities(stretch, middle + d) for d in (0.0, h, -h))
        slopes = (ahead - behind)[rows["velocity"]] / (2 * h)
        for k in range(len(middle)):
            part = {name: now[row, k] for name, row in rows.items()}
            x = np.concatenate([[0.0], part["length"], part["velocity"][:1], part["rate"]])
            ode, velocities, accelerations, mean, force, power = (
                np.array(value).ravel()
                for value in model(x, part["acceleration"], part["reaction"])
            )
            size = np.abs(part["actuator_force"]).max() + load
            assert ode[: n + 1] == pytest.approx([part["velocity"][0], *part["rate"]])
            assert ode[n + 2 :] == pytest.approx(part["acceleration"])
            assert velocities == pytest.approx(part["velocity"], abs=1e-11)
            assert accelerations == pytest.approx(slopes[:, k], abs=1e-4 * size)
            assert ode[n + 1] == pytest.approx(accelerations[0])
            assert mean == pytest.approx(part["reaction_mean"], abs=1e-10 * size)
            assert force == pytest.approx(part["actuator_force"], abs=1e-9 * size)
            assert power == pytest.approx(part["power"], abs=1e-9 * size)
            checked += 1
    assert checked >= 7 * min(2, len(motion.stretches))


def test_the_spiked_worm_tells_what_it_is():
    worm = spiked_worm([1.0, 2.0, 3.0], 0.1, 4.0, length_nominal=0.5, time_nominal=0.1)
    names = {s.name: (s.size, s.unit, s.nominal) for s in (*worm.x, *worm.u)}
    assert names["length"] == (2, "length", 0.5)
    assert names["velocity"] == (1, "speed", pytest.approx(5.0))
    assert names["acceleration"] == (2, "acceleration", pytest.approx(50.0))
    assert worm.n_x == 6
    assert [c.name for c in worm.contacts] == ["mass 0", "mass 1", "mass 2"]
    for contact in worm.contacts:
        assert isinstance(contact.law, Spike)
        assert contact.nominal_force == pytest.approx(100.0)  # mean mass 2 times 50
        assert contact.law.scale == contact.nominal_force
    with pytest.raises(KeyError, match=r"no signal 'speed'.*reaction_mean.*actuator_force.*power"):
        worm["speed"]


def test_time_in_a_contact_velocity_is_differentiated_too():
    """A block on a belt of velocity t^2: relative acceleration force / m - 2 t."""
    v, f, t = ca.SX.sym("v"), ca.SX.sym("f"), ca.SX.sym("t")
    belt = Contact("sole", v - t**2, f, Viscous(1.0))
    model = Model("block", [Signal("velocity", v)], f / 2, t=t, contacts=[belt])
    slope = ca.Function("slope", [t, f], [model.contact_accelerations])
    assert float(slope(3.0, 4.0)) == pytest.approx(4.0 / 2 - 6.0)
    assert float(ca.evalf(model.delassus)) == 0.5


def test_a_model_without_contacts_has_empty_columns():
    v = ca.SX.sym("v", 2)
    model = Model("free", [Signal("velocity", v)], -v, outputs=[Output("twice", 2 * v)])
    assert (model.n_x, pack(model.u).shape, model.forces.shape) == (2, (0, 1), (0, 1))
    assert model.contact_velocities.shape == (0, 1)
    assert model.delassus.shape == (0, 0)
    assert ca.is_equal(model["twice"], 2 * v, 2)


@pytest.mark.parametrize(
    ("part", "kind"),
    [
        *dict.fromkeys("xuzp", "Signal").items(),
        ("outputs", "Output"),
        ("contacts", "Contact"),
        ("switches", "Switch"),
        ("schedules", "Schedule"),
        ("delays", "Delay"),
    ],
)
@pytest.mark.parametrize("given", [1.0, [1.0], ca.SX.sym("v"), [ca.SX.sym("v")], {"v": 1.0}])
def test_numbers_and_symbols_are_no_parts_of_a_model(part: str, kind: str, given: Any):
    v = ca.SX.sym("v")
    parts: dict[str, Any] = {"x": [Signal("speed", v)], part: given}
    with pytest.raises(ArgumentError, match=f"model cart: {part} must be a list of {kind}, not "):
        Model("cart", ode=v, **parts)


def test_models_that_do_not_fit_together_are_refused():
    v, w = ca.SX.sym("v", 2), ca.SX.sym("w")
    with pytest.raises(
        ValueError,
        match=r"model cart: ode must be a column of 2, one for each state, not .*\(1, 1\)",
    ):
        Model("cart", [Signal("velocity", v)], w)
    for other in ("u", "z", "p"):
        signals = {other: [Signal("velocity", w)]}
        with pytest.raises(ValueError, match="two signals share the name"):
            Model("cart", [Signal("velocity", v)], v, **signals)  # type: ignore[arg-type]


def test_places_are_the_first_half_of_the_states():
    a, b, v = ca.SX.sym("a"), ca.SX.sym("b", 2), ca.SX.sym("v", 3)
    states = [Signal("a", a), Signal("b", b), Signal("rate", v)]
    model = Model("three", states, ca.vertcat(v, -a, -b))
    assert model.places() == tuple(states[:2])
    both = ca.SX.sym("both", 2)
    for other in (
        Model("mixed", states, ca.vertcat(v[0], v[2], v[1], -a, -b)),
        Model("odd", [Signal("a", a)], -a),
        Model("halved", [Signal("both", both)], ca.vertcat(both[1], -both[0])),
    ):
        with pytest.raises(ArgumentError, match=f"{other.name}: states must be coordinates"):
            other.places()


@pytest.mark.parametrize(
    ("bounds", "value", "words"),
    [
        ({"lower": TINY}, 0.0, "c must be positive, not 0"),
        ({"lower": 0.0}, -1.0, "c must be 0 or above, not -1"),
        ({"lower": 0.0, "upper": 1.0}, np.nan, "c must be 0 or above and at most 1, not nan"),
        ({"lower": 0.5}, 0.4, "c must be at least 0.5, not 0.4"),
        ({"upper": 2.0}, 2.5, "c must be at most 2, not 2.5"),
    ],
)
def test_values_beyond_their_bounds_are_refused(bounds: dict[str, Any], value: float, words: str):
    signal = Signal("c", ca.SX.sym("c", 2), **bounds)
    signal.check(np.array([1.0, 1.0]))
    with pytest.raises(ArgumentError, match=words):
        signal.check(np.array([1.0, value]))


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("start", [0.0, 0.3, -7.1, 50.0])
@pytest.mark.parametrize("span", [(0.05, 10.03), (-4.33, 2.56), (0.72, 0.78)])
def test_breaks_between_two_times_are_those_of_all_turns(periodic, start, span):
    breaks = np.array([0.0, 0.1, 0.4, 0.7])
    symbols = ca.SX.sym("c"), ca.SX.sym("begin")
    schedule = Schedule("c", *symbols, breaks, np.zeros((3, 1)), periodic, start)
    turns = np.arange(-200, 200) if periodic else [0]
    ends = np.sort([start + 0.7 * k + end for k in turns for end in breaks[1 : 3 + periodic]])
    inside = ends[(span[0] < ends) & (ends < span[1])]
    assert schedule.breaks_between(*span) == pytest.approx(inside, abs=1e-12)


def test_the_next_break_is_always_a_later_one():
    """Also where a schedule starts far from the times asked for, so that its breaks are rounded."""
    rng = np.random.default_rng(5)
    for start in [0.0, -7.1, 50.0, 1e3, -1e4] * 20:
        breaks = np.append(0.0, np.cumsum(rng.uniform(0.01, 1.0, 3)))
        begin = start * rng.uniform(0.5, 1.0)
        symbols = ca.SX.sym("c"), ca.SX.sym("begin")
        schedule = Schedule("c", *symbols, breaks, np.zeros((3, 1)), True, begin)
        times = [rng.uniform(0.0, 2.0)]
        for _ in range(20):
            times.append(schedule.next_break(times[-1]))
        assert np.diff(times).min() > 0.0
        assert times[-1] - times[-19] == pytest.approx(6 * breaks[-1], rel=1e-9)
