"""A segment of a peristaltic worm: closed forms, energies, shooting, its scenes."""

import math
from dataclasses import replace
from typing import Any

import casadi as ca
import hypothesis.strategies as st
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from outcomes import refusals, value

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.magnetics.coils import CoilRow
from wormopt.magnetics.pressure import magnetic_pressure
from wormopt.magnetics.winding import Coil
from wormopt.numerics.chebyshev import resolve
from wormopt.numerics.roots import root
from wormopt.pictures import figure
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.peristaltic.membranes import (
    NEUTRAL,
    Fibres,
    balloon,
    fill_at,
    free_stretch,
    inflated,
    limit_of_inflation,
    loading_at,
    range_of_fill,
)
from wormopt.systems.peristaltic.peristaltic_segment import wall_work_error
from wormopt.systems.peristaltic.segment import (
    Segment,
    WoundSegment,
    density,
)
from wormopt.systems.peristaltic.tables import Tube

SCENE, RUBBER = "peristaltic_segment", "peristaltic_rubber"
SOFT = Segment(20e-3, 5e-3, 0.3e-3, 20e3)
PRESSURE = 564.0
LAM, HOOP, SHARE = ca.SX.sym("lam"), ca.SX.sym("hoop"), ca.SX.sym("a")
STRETCHES = st.floats(0.5, 2.0)
SHARES = st.floats(0.0, 1.0)


def at(expression: Any, **numbers: float) -> float:
    """Value of an expression in stretch, hoop and neo-Hookean share."""
    function = ca.Function("at", [LAM, HOOP, SHARE], [expression])
    return float(function(*(numbers.get(name, 1.0) for name in ("lam", "hoop", "a"))))


# ---- strokes


def test_deepest_stroke_is_that_of_the_best_coil():
    deepest = SOFT.deepest_stretch(PRESSURE)
    assert deepest**3 + SOFT.loading(PRESSURE) * deepest / 2 == pytest.approx(1.0, rel=1e-13)
    reached = {
        c: Segment(20e-3, 5e-3, 0.3e-3, 20e3, c).stretch_at(PRESSURE)
        for c in (0.9, deepest - 1e-6, deepest + 1e-6, 0.95)
    }
    assert min(reached.values()) == pytest.approx(deepest, abs=2e-6)
    even = replace(SOFT, coil_share=1.0)  # the fluid is wholly in an even field
    assert even.stretch_at(PRESSURE) == even.stretch_at(0.0) == 1.0
    # a longer coil stops the segment where it lies in it wholly
    assert reached[0.95] == 0.95
    # and so does one that is strong enough to pull it in
    assert SOFT.stretch_at(10 * PRESSURE) == 0.5


def test_hold_on_a_tube():
    tube = Tube(5.05e-3, 0.3)
    assert tube.stretch_at_contact(SOFT) == pytest.approx(0.98029604941, abs=5e-12)
    assert tube.surplus(SOFT, PRESSURE) == pytest.approx(11.67975233e-3, abs=5e-12)


# ---- a given pressure


def test_inflation_in_closed_form():
    found = inflated(0.3)
    assert found.hoop == pytest.approx(1.09097612018, abs=5e-12)
    assert found.stretch == pytest.approx(1.00535492381, abs=5e-12)
    limit = limit_of_inflation()
    assert limit is not None
    assert limit == pytest.approx((0.74986767306, 1.57687464587, 1.17818768931), abs=6e-12)
    # as simple as that without the second invariant
    hoop = 1.3
    square = (hoop**4 + math.sqrt(hoop**8 + 8 * hoop**2)) / (4 * hoop**2)
    assert free_stretch(hoop) == pytest.approx(math.sqrt(square), rel=1e-14)


@pytest.mark.parametrize("a", [1.0, 0.9, 0.75, 0.0])
def test_the_limit_is_the_largest_pressure(a: float):
    limit = limit_of_inflation(a)
    assert limit is not None
    slope = ca.Function("slope", [HOOP], [ca.gradient(loading_at(HOOP, a), HOOP)])
    assert root(lambda hoop: float(slope(hoop)), 1.2, 2.4) == pytest.approx(limit.hoop, abs=1e-11)
    with pytest.raises(ArgumentError, match=f"inflation, {limit.loading:.6g}"):
        inflated(limit.loading * 1.0001, a)


@given(STRETCHES, STRETCHES, SHARES)
@settings(max_examples=examples(20))
def test_both_invariants_have_the_same_limit(lam: float, hoop: float, a: float):
    # (1 / lam, lam hoop) exchanges them and keeps the volume
    assert density(1 / lam, lam * hoop, 1 - a) == pytest.approx(density(lam, hoop, a), abs=1e-11)
    one, other = limit_of_inflation(0.9), limit_of_inflation(0.1)
    assert one is not None
    assert other == pytest.approx((one.loading, one.hoop * one.stretch, 1 / one.stretch), rel=1e-11)


def test_no_limit_where_rubber_stiffens():
    assert limit_of_inflation(0.5) is None
    assert np.all(np.diff(loading_at(np.linspace(1, 5, 200), 0.5)) > 0)


def test_small_pressures_hardly_change_the_length():
    def off(kappa: float) -> tuple[float, float]:
        _, hoop, stretch = inflated(kappa)
        return (hoop - 1) / (kappa / 4) - 1, (stretch - 1) / (kappa**2 / 24) - 1

    (hoop1, stretch1), (hoop2, stretch2) = off(0.02), off(0.01)
    assert 1.9 < hoop1 / hoop2 < 2.1
    assert 1.9 < stretch1 / stretch2 < 2.1
    assert abs(hoop2) < 0.02
    assert abs(stretch2) < 0.05


# ---- fibres


@pytest.mark.parametrize("degrees", [1e-12, 1e-8, 1e-4])
def test_fibres_along_the_axis_hold_the_length(degrees: float):
    """Energy and p V at stretch 1 are stationary at th - th^-3 = kappa th: th^-4 = 1 - kappa."""
    known = (1 - PRESSURE * SOFT.radius / (SOFT.shear_modulus * SOFT.wall)) ** -0.25
    angle = Fibres(SOFT, math.radians(degrees)).angle_at(PRESSURE)
    assert angle / math.radians(degrees) == pytest.approx(known, rel=1e-9)


def test_a_pressure_that_turns_fibres_all_round_is_refused():
    with pytest.raises(ArgumentError, match="write a lower pressure, or an angle nearer to 45"):
        Fibres(SOFT, 0.5).angle_at(-1e30)


def test_small_strokes_of_fibres():
    fibres = Fibres(SOFT, math.radians(35))
    b = 1 / math.tan(fibres.angle) ** 2
    linear = -(2 * b - 1) / (8 * (1 - b + b * b))

    def off(kappa: float) -> float:
        angle = fibres.angle_at(kappa * SOFT.shear_modulus * SOFT.wall / SOFT.radius)
        return (float(fibres.stretches(angle)[0]) - 1) / (kappa * linear) - 1

    assert 1.9 < off(2e-3) / off(1e-3) < 2.1
    assert abs(off(1e-3)) < 1e-3


def test_sealed_fibres_are_locked_between_two_angles():
    assert math.degrees(NEUTRAL) == pytest.approx(54.73561032, abs=5e-9)
    low, high = range_of_fill(0.9)
    assert math.degrees(low) == pytest.approx(43.89478387, abs=5e-9)
    assert math.degrees(high) == pytest.approx(65.09840060, abs=5e-9)
    assert float(fill_at(low)) == pytest.approx(0.9, rel=1e-13)
    assert range_of_fill(1.0) == (NEUTRAL, NEUTRAL)
    assert float(fill_at(NEUTRAL)) == pytest.approx(1.0, rel=1e-15)
    assert float(Fibres(SOFT, 0.6).pull(NEUTRAL, PRESSURE)) == pytest.approx(0.0, abs=1e-15)


# ---- barrel and true membrane


def test_the_true_membrane():
    found = balloon(2.0, loading=0.3)
    assert found.radius[0] == pytest.approx(1.08679102979, abs=6e-12)
    assert found.stretch == pytest.approx(1.00627191695, abs=5e-12)
    assert found.volume == pytest.approx(1.14722570292, abs=6e-12)
    sealed = balloon(2.0, volume=found.volume)
    assert sealed.loading == pytest.approx(0.3, abs=1e-11)


def test_long_membranes_are_cylinders_in_the_middle():
    for a in (1.0, 0.8):
        long = balloon(8.0, loading=0.3, neo_hookean=a)
        assert long.radius[0] == pytest.approx(inflated(0.3, a).hoop, abs=2e-4)


def test_membranes_without_tension_are_refused():
    with pytest.raises(ArgumentError, match=r"write more than 0\.4"):
        balloon(2.0, loading=0.3, pull=-0.2)
    with pytest.raises(ArgumentError, match="either loading or volume"):
        balloon(2.0)
    with pytest.raises(SolveError, match="no equilibrium of the membrane"):
        balloon(2.0, loading=3e-3)
    with pytest.raises(SolveError, match="not under tension") as caught:
        balloon(2.0, volume=0.9)
    assert caught.value.code == "wrinkled"


# ---- a real coil


def test_a_real_coil_pulls_by_its_field():
    winding = Coil(6e-3, 10e-3, 10e-3)
    wound, turns, lam = WoundSegment(SOFT, winding, 0.35), 900.0, 0.97
    row = CoilRow(winding, count=1, pitch=1.0, axis="along")
    half = lam * SOFT.length / 2
    nodes, weights = np.polynomial.legendre.leggauss(60)
    places = np.append(half * nodes, half)
    field = np.sqrt(row.square(places, 0.0, [turns]))
    pressure = np.asarray(magnetic_pressure(1.35, field))
    section = math.pi * SOFT.radius**2 / lam
    wanted = section * (pressure[:-1] @ weights / 2 - pressure[-1])
    assert wound.coil_pull(lam, turns) == pytest.approx(wanted, rel=1e-9)
    # and by the energy -(V / l) times the integral of the pressure

    def energy(lam: np.ndarray) -> np.ndarray:
        along = np.multiply.outer(nodes, lam) * SOFT.length / 2
        mean = weights @ np.asarray(wound.pressure(along, turns))
        return -SOFT.volume / 2 * mean[None]

    slope = resolve(energy, 0.9, 1.04).derivative()(np.array([lam]))[0, 0] / SOFT.length
    assert slope == pytest.approx(wanted, rel=1e-9)
    ideal = Segment(20e-3, 5e-3, 0.3e-3, 20e3, wound.share(lam))
    middle = wound.pressure(0.0, turns)
    assert ideal.coil_pull(lam, middle) == pytest.approx(wound.coil_pull(lam, turns), rel=1e-12)
    stretch = wound.stretch_at(turns)
    rest = SOFT.elastic_pull(stretch) + wound.coil_pull(stretch, turns)
    assert abs(rest) < 1e-12


# ---- bad input


@pytest.mark.parametrize("name", ["radius_at", "energy", "elastic_pull"])
def test_what_is_no_stretch_is_refused(name: str):
    for bad in (0.0, -0.9, np.array([1.0, -1.0]), math.nan):
        with pytest.raises(ArgumentError, match="a stretch must be above 0"):
            getattr(SOFT, name)(bad)


def test_what_is_no_segment_is_refused():
    with pytest.raises(ArgumentError, match="coil_share must be from 0 to 1"):
        Segment(20e-3, 5e-3, 0.3e-3, 20e3, 1.5)
    with pytest.raises(ArgumentError, match=r"radius must be below 0\.004"):
        Tube(4e-3, 0.3).stretch_at_contact(SOFT)
    with pytest.raises(ArgumentError, match="pressure must be 0 or above"):
        SOFT.stretch_at(-1.0)
    with pytest.raises(ArgumentError, match="between 0 and 90"):
        Fibres(SOFT, 2.0)
    with pytest.raises(ArgumentError, match="fill"):
        range_of_fill(1.1)
    with pytest.raises(ArgumentError, match="inner must be above"):
        WoundSegment(SOFT, Coil(4e-3, 10e-3, 10e-3), 0.35)


def test_rubber_too_soft_for_any_stretch_is_refused():
    """Neo-Hookean rubber in the best coil: lam³ + kappa lam / 2 = 1."""
    unit = SOFT.loading(1.0)
    for stretch in (1e-3, 3e-9):
        kappa = 2 * (1 - stretch**3) / stretch
        assert SOFT.deepest_stretch(kappa / unit) == pytest.approx(stretch, rel=1e-9)
    with pytest.raises(ArgumentError, match=r"shrink to nothing.*smaller pressure"):
        SOFT.deepest_stretch(2e9 / unit)
    # rubber of Mooney's second kind alone pulls with no more than its stiffness
    soft = replace(SOFT, neo_hookean=0.0)
    assert soft.stretch_at(0.0, 0.9 * soft.stiffness) > 1
    with pytest.raises(ArgumentError, match="without limit"):
        soft.stretch_at(0.0, 1.1 * soft.stiffness)


# ---- scenes


@pytest.fixture(scope="module")
def packaged() -> Result:
    return wo.run(SCENE)


def test_the_packaged_scene(packaged: Result):
    assert packaged.status == "ok"
    assert packaged.trust["warnings"] == []
    assert value(packaged, "stretch") == pytest.approx(0.95919057931, abs=5e-12)
    assert value(packaged, "stroke_loaded") * 20 == pytest.approx(0.53319386963, abs=1e-10)
    assert value(packaged, "holding") == pytest.approx(0.3 * 90.69002034e-3, abs=5e-12)
    assert value(packaged, "fibre_stretch") == pytest.approx(0.93741841168, abs=5e-12)
    assert value(packaged, "pressure_max") == pytest.approx(0.74986767306 * 1200, rel=1e-10)
    assert value(packaged, "moves") is True
    assert value(packaged, "winding_pressure") == pytest.approx(PRESSURE, rel=1e-2)
    assert 0.4 < value(packaged, "winding_share") < 0.5
    assert {"sealed", "ideal coil", "cylinder", "no wrinkles"} <= set(packaged.trust["assumptions"])
    # the return of the rubber pushes two, the wall holds two more
    drag = value(packaged, "drag")
    assert int(value(packaged, "return_force") / drag) == 2


def test_ordinary_rubber_will_not_move():
    result = wo.run(RUBBER)
    assert result.status == "ok"
    assert round(100 * value(result, "stroke"), 2) == 0.14
    assert value(result, "moves") is False
    assert value(result, "normal_force") == 0.0
    (warning,) = result.trust["warnings"]
    assert warning.startswith("the segment will not move: it swells by 3.53 µm of the 50 µm")
    facts = " ".join(text.get_text() for text in figure(result, "segment").texts)
    assert "will not move" in facts
    # what is advised would do
    for key, advised in (
        ("coil.pressure", value(result, "pressure_to_wall")),
        ("segment.shear_modulus", value(result, "modulus_to_wall")),
    ):
        for more, sign in ((1.001, 1), (0.999, -1)):
            changed = advised * more
            scene = load_scene(RUBBER, [f"{key}={changed}", "samples=11"])
            touches = value(wo.run(scene), "normal_force") > 0
            assert touches == ((sign > 0) == (key == "coil.pressure"))


@pytest.mark.parametrize("pressure", [100.0, 1e-6])  # 1e-6: the wall's tension is rounding
def test_a_pressure_too_small_for_the_true_membrane(pressure: float):
    result = wo.run(load_scene(RUBBER, [f"inflation={{pressure={pressure}}}"]))
    assert result.status == "ok"
    assert any("bends only at its rings" in text for text in result.trust["warnings"])
    assert "membrane_hoop" not in result.scalars
    assert value(result, "inflated_hoop") == pytest.approx(1 + pressure / 33333.3 / 4, rel=1e-5)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("load=0.02", "the wall holds"),
        ("segment.length=0.2", "the rubber pushes with"),
        ("coil.share=1.0", "coil.share below 0.9803"),
        ("coil.pressure=100", "the segment sags"),
        ("pipe.friction=0", "without friction nothing holds"),
        ("load=4e-3 pipe.friction=0", "the wall holds 0 mN, less than load and drag, 4 mN"),
    ],
)
def test_why_it_does_not_move(change: str, says: str):
    scene = load_scene(RUBBER, ["segment.shear_modulus=2e4", "segment.wall=3e-4", *change.split()])
    result = wo.run(scene)
    assert value(result, "moves") is False
    assert any(says in text for text in result.trust["warnings"])


test_wrong_scenes_are_told = refusals(
    SCENE,
    """
    inflation.pressure=900 | inflation.pressure | write at most 899.841
    segment.shear_modulus=5e3 & segment.neo_hookean=0.5 | inflation.pressure | 8-fold; write
    pipe.radius=0.005 | pipe.radius | write more than 0.005
    stretches=[-0.8, 1.1] | stretches[0] | above 0
    segment.wall=4e-3 | segment.wall | less than 0.0025
    winding.inner_radius=5e-3 | winding.inner_radius | more than 0.00505
    winding.outer_radius=5e-3 | winding.inner_radius | not below outer_radius = 0.005
    inflation={pressure=9.0, fill=0.5} | inflation.fill | fibre_angle
    segment.shear_modulus=1e-30 | segment.shear_modulus | a larger modulus
    """,
)


@pytest.mark.parametrize("length", [2e-3, 0.2])
def test_the_work_of_the_wall_is_known_of_short_and_long_segments(length: float):
    segment, tube = Segment(length, 5e-3, 0.3e-3, 20e3), Tube(5.05e-3, 0.3)
    assert wall_work_error(segment, tube, 4.0) <= 1e-9


def test_a_wrong_stretch_fails(monkeypatch: pytest.MonkeyPatch):
    right = Segment.stretch_at
    monkeypatch.setattr(Segment, "stretch_at", lambda self, *given: right(self, *given) + 1e-4)
    result = wo.run(RUBBER)
    assert result.status == "failed"
    assert "from that of the least energy" in result.reason
