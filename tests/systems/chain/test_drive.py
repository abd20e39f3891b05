"""Plants driven open loop, against equations written by hand and closed forms."""

from collections.abc import Callable
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wormopt.control.drive import drive
from wormopt.control.loop import gait_reference
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal, Switch
from wormopt.simulation.options import Smooth
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import travelling_sine
from wormopt.systems.spiked.dynamics import spiked_worm

MASS, DRAG, LOAD = np.array([1.0, 2.0, 0.5]), np.array([0.1, 0.0, 0.3]), np.array([0.0, 0.2, 0.1])
STIFFNESS, DAMPING, REST = np.array([10.0, 8.0]), np.array([2.0, 3.0]), np.array([2.0, 1.5])
CUBICS = Gait(
    np.array([0.0, 0.3, 1.0, 1.1]), np.random.default_rng(3).normal(scale=4.0, size=(3, 2, 4))
)


def worm() -> Model:
    return chain(
        2, mass=MASS, stiffness=STIFFNESS, damping=DAMPING, rest_length=REST,
        law=Coulomb(1.0, 10.0), drag=DRAG, load=LOAD, velocity=[0.3, -0.1, 0.2],
    )  # fmt: skip


def course_by_hand(t: float, breaks: np.ndarray, periodic: bool) -> np.ndarray:
    """Value of CUBICS, term by term; ``breaks`` brackets the stretch in which t lies."""
    middle = breaks.mean()
    if periodic:
        turn = np.floor(middle / 1.1) * 1.1
        middle, t = middle - turn, t - turn
    elif middle > 1.1:
        middle, t = 1.05, 1.1
    k = int(np.sum(CUBICS.breaks <= middle)) - 1
    s = t - CUBICS.breaks[k]
    return np.sum([CUBICS.polynomial[k, :, power] * s**power for power in range(4)], axis=0)


def rates_by_hand(x: np.ndarray, u: np.ndarray, v_reg: float) -> np.ndarray:
    """(8)-(12) for three masses, with the chapter's smooth friction."""
    position, v = x[:3], x[3:]
    mu = STIFFNESS * (-np.diff(position) - REST) + DAMPING * -np.diff(v) - u
    friction = -(5.5 * np.tanh(v / v_reg) - 4.5)
    net = friction - DRAG * v - LOAD + np.array([-mu[0], mu[0] - mu[1], mu[1]])
    return np.concatenate([v, net / MASS])


@pytest.mark.parametrize("periodic", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_driven_chain_moves_as_by_hand(periodic: bool):
    """Three pieces of cubics with jumps, and twice as long again."""
    until, v_reg = 3.0, 0.05
    turns = [0.0, 1.1, 2.2] if periodic else [0.0]
    ends = sorted({turn + b for turn in turns for b in CUBICS.breaks if turn + b < until} | {until})
    plant = worm()
    x = np.concatenate([np.asarray(s.value, float) for s in plant.x])
    expected = [x]
    for stretch in pairwise(ends):

        def rates(t: float, x: np.ndarray, at: np.ndarray = np.array(stretch)) -> np.ndarray:  # noqa: B008
            return rates_by_hand(x, course_by_hand(t, at, periodic), v_reg)

        part = solve_ivp(rates, stretch, expected[-1], "DOP853", rtol=1e-13, atol=1e-14)
        expected.append(part.y[:, -1])
    driven = drive(plant, CUBICS, periodic=periodic)
    motion = simulate(driven, until, contact=Smooth(v_reg), times=ends)
    assert motion.states == pytest.approx(np.array(expected).T, abs=1e-9)


def test_outputs_show_the_inputs_wherever_they_stand():
    plant = worm()
    driven = drive(plant, CUBICS)
    t = np.array([0.0, 0.1, 0.3, 0.7, 1.05, 1.1, 2.5])
    motion = simulate(driven, 2.5, times=t)
    inside = CUBICS(np.minimum(t[:5], 1.0999))
    last = CUBICS.on_piece(2, np.array([0.1]))
    u = np.hstack([inside, last, last])
    assert motion["input"] == pytest.approx(u, abs=1e-12)
    rate = -np.diff(motion["velocity"], axis=0)
    assert motion["power"] == pytest.approx(u * rate, abs=1e-11)
    spring = motion["spring_force"]
    assert motion["link_force"] == pytest.approx(spring - u, abs=1e-11)
    assert [o.name for o in driven.outputs] == [*(o.name for o in plant.outputs), "input"]


def test_forces_that_jump_move_a_free_link_without_any_error():
    """l'' = 2 u / m is integrated exactly if no step goes across a jump."""
    plant = chain(1, mass=2.0, stiffness=0.0, damping=0.0, rest_length=1.0)
    bang = Gait(np.array([0.0, 0.7, 1.9, 2.0]), np.array([3.0, -5.0, 1.0]).reshape(3, 1, 1))
    motion = simulate(drive(plant, bang), 4.0, times=[0.0, 0.7, 1.9, 2.0, 4.0])
    length, rate, by_hand = 1.0, 0.0, [1.0]
    for h, u in ((0.7, 3.0), (1.2, -5.0), (0.1, 1.0), (2.0, 1.0)):
        length, rate = length + rate * h + u * h**2 / 2, rate + u * h
        by_hand.append(length)
    assert motion["length"][0] == pytest.approx(by_hand, abs=1e-13)
    assert motion.n_rejected == 0


@pytest.mark.compiled  # in Python, rounding makes one mass stick again for 1e-13
def test_rest_and_sliding_of_a_driven_pair():
    """Two masses 1 pushed apart and together; friction 1 on both; no springs.

    u = t until 2: rest until u = 1, then v = (t - 1)^2 / 2, so v = 1/2 after 1/6. Then u = 0: both
    stop at 2.5 after another 1/8. From 3 on u = -3/2, also after the last break at 4.
    """
    plant = chain(1, mass=1.0, stiffness=0.0, damping=0.0, rest_length=3.0, law=Coulomb(1.0, 1.0))
    values = np.array([[[0.0, 1.0]], [[0.0, 0.0]], [[-1.5, 0.0]]])
    driven = drive(plant, Gait(np.array([0.0, 2.0, 3.0, 4.0]), values))
    motion = simulate(driven, 5.0, times=[0.9, 2.0, 2.7, 4.0, 5.0])
    moved = np.array([0.0, 1 / 6, 7 / 24, 7 / 24 - 1 / 4, 7 / 24 - 1])
    assert motion["position"] == pytest.approx(np.array([3 + moved, -moved]), abs=1e-10)
    events = {(round(e.time, 9), e.kind) for e in motion.events}
    assert events == {(1.0, "release"), (2.5, "stick"), (3.0, "release")}


def test_other_values_of_the_course_need_no_other_model():
    plant, other = worm(), Gait(CUBICS.breaks, -0.5 * CUBICS.polynomial)
    driven, redrawn = drive(plant, CUBICS), drive(plant, other)
    (schedule,) = redrawn.schedules
    motion = simulate(driven, 1.5, schedules={"input": schedule.values})
    assert motion.end == pytest.approx(simulate(redrawn, 1.5).end, abs=1e-12)


def test_all_inputs_of_a_plant_are_driven_in_their_order():
    x, a, b = ca.SX.sym("x", 2), ca.SX.sym("a"), ca.SX.sym("b")
    states, inputs = [Signal("x", x, value=0.0)], [Signal("a", a, "speed"), Signal("b", b, "force")]
    switches = [Switch("limit", a * x[0] - 1, ca.vertcat(x[0], b))]
    outputs = [Output("difference", a - b)]
    plant = Model("pair", states, ca.vertcat(a, b), u=inputs, switches=switches, outputs=outputs)
    driven = drive(plant, Gait(np.array([0.0, 1.0]), np.array([[[2.0], [-3.0]]])))
    assert simulate(driven, 0.2).end == pytest.approx([0.4, -0.6])
    motion = simulate(driven, 1.0)
    assert [e.time for e in motion.events] == [pytest.approx(0.25)]
    assert motion.end == pytest.approx([2.0, -3 - 3 * 0.75])  # it jumps to b = -3 at t = 1/4
    assert motion["input"][:, -1] == pytest.approx([2.0, -3.0])
    assert motion["difference"][0, -1] == pytest.approx(5.0)


def test_accelerations_drive_a_spiked_worm():
    plant = spiked_worm([1.0, 1.0, 1.0], drag=0.0, load=0.0)
    driven = drive(plant, Gait(np.array([0.0, 1.0]), np.array([[[0.5], [-0.5]]])))
    assert list(driven.u) == []
    assert [o.unit for o in driven.outputs if o.name == "input"] == ["acceleration"]


@pytest.mark.parametrize("shift", [-0.4, 0.0, 0.5, 7.0])
def test_a_reference_that_ends_holds_its_ends(shift: float):
    """Harmonics and polynomials; before, after, and inside against the gait itself."""
    for gait in (travelling_sine(2, 1.3), CUBICS):
        time = ca.SX.sym("t")
        reference = gait_reference(gait, time, shift=shift, periodic=False)
        (schedule,) = reference.schedules
        f = ca.Function(
            "f", [time, schedule.symbol, schedule.begin], [reference.value, reference.rate]
        )
        t = np.linspace(-3.0, 4.0, 57) + 1e-3
        begin, piece = schedule.locate(t)
        value, rate = (np.array(part) for part in f(t[None], schedule.values[piece].T, begin[None]))
        end = gait.on_piece(-1, gait.period - gait.breaks[-2:-1])
        at = t + shift
        expected = np.where(at < gait.period, gait(np.clip(at, 0, gait.period)), end)
        assert value == pytest.approx(expected, abs=1e-12)
        runs = (at > 0) & (at < gait.period)
        assert rate == pytest.approx(np.where(runs, gait(at, 1), 0.0), abs=1e-10)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: drive(worm(), travelling_sine(3, 1.0)), "3 rows for 2 scalar inputs"),
        (lambda: drive(worm(), np.zeros(2)), "inputs must be a Gait"),  # type: ignore[arg-type]
        (lambda: drive(drive(worm(), CUBICS), CUBICS), "2 rows for 0 scalar inputs"),
    ],
)
def test_inputs_that_do_not_fit_are_refused(build: Callable[[], object], message: str):
    with pytest.raises(ValueError, match=message):
        build()


def bounded(size: int = 1, *, lower: float = -np.inf, upper: float = np.inf) -> Model:
    """Places whose rates are the inputs."""
    x, u = ca.SX.sym("x", size), ca.SX.sym("u", size)
    inputs = [Signal("u", u, "speed", lower=lower, upper=upper)]
    return Model("cart", [Signal("x", x, value=0.0)], u, u=inputs)


def test_a_course_is_cut_to_the_bounds_of_its_inputs():
    ramps = Gait(np.array([0.0, 1.0]), np.array([[[0.0, 4.0], [1.0, -4.0]]]))
    motion = simulate(drive(bounded(2, lower=-2.0, upper=1.0), ramps), 1.0, times=[0.2, 0.5, 1.0])
    # u = min(4 t, 1) and max(1 - 4 t, -2)
    assert motion.end == pytest.approx([1 / 8 + 3 / 4, 3 / 4 - 9 / 8 - 1 / 2], abs=1e-9)
    assert motion["input"] == pytest.approx(np.array([[0.8, 1, 1], [0.2, -1, -2]]))
    assert motion["saturated"].tolist() == [[0, 1, 1], [0, 0, 1]]
    (said,) = motion.warnings
    assert "cut to their bounds" in said


def test_a_course_along_a_bound_is_not_cut_for_its_rounding():
    """Terms of a polynomial of degree 5 that is 1 but for the rounding of a sum."""
    breaks, terms = np.linspace(0.0, 1.0, 8), np.random.default_rng(0).normal(size=(7, 1, 6))
    terms[:, :, 1:] *= 1e-10
    terms[:, :, 0] = 1.0
    driven = drive(bounded(upper=1.0), Gait(breaks, terms))
    motion = simulate(driven, 1.0)
    assert not motion.events
    assert not motion["saturated"].any()
    assert motion.warnings == ()
    assert motion.end == pytest.approx([1.0], abs=1e-9)


@pytest.mark.parametrize("sided", [{"upper": 1.0}, {"lower": -1.0}, {"lower": -1.0, "upper": 1.0}])
def test_bounds_may_have_one_side(sided: dict[str, float]):
    course = Gait(np.array([0.0, 1.0, 2.0]), np.array([[[3.0]], [[-3.0]]]))
    end = simulate(drive(bounded(1, **sided), course), 2.0).end
    assert end == pytest.approx([sided.get("upper", 3.0) + sided.get("lower", -3.0)])
