"""Scenes of kind "harmonic-masses": what they say of themselves, results, refusals."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hints import Patch
from outcomes import failed_checks, refusals, refused, value
from swinging_masses import COULOMB, PERIOD, SCENE, THIRDS, mean_force, solved, solved_anew

from wormopt.analysis.average import average
from wormopt.cli import main
from wormopt.errors import SolveError
from wormopt.model.friction import Stribeck
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.shared.proof import CrossCheck
from wormopt.systems.swinging import steady as steadies
from wormopt.systems.swinging.harmonic_masses import Masses
from wormopt.systems.swinging.prescribed import harmonic_masses
from wormopt.systems.swinging.steady import Runner, SlowVelocity, Steady, sign_changes, tends_to

# -- what a scene says of itself -------------------------------------------------------------------


def worm_of(changes: Sequence[str]) -> Masses:
    table: Any = load_scene(SCENE, changes).table
    return table.worm


UNEQUAL = [
    "worm.masses=2", "worm.mass=[1, 2]", "worm.frequency=4",
    "worm.harmonic.0.amplitude=[1, 0.5]", "worm.harmonic.0.phase=[30, 210]",
]  # fmt: skip


@pytest.mark.parametrize(
    ("law", "largest"),
    [
        ('{kind="coulomb", forward=0.006, backward=0.02}', 2 * 0.02),
        ('{kind="coulomb", forward=0.02, backward=0.006}', 2 * 0.02),
        ('{kind="viscous", drag=0.01}', 0.01 * 1.0 + 0.01 * 0.5),
        ('{kind="stribeck", forward=0.001, backward=0.002, stick_forward=0.03, '
         'stick_backward=0.04, v_stribeck=0.8}', 2 * 0.04),
    ],
)  # fmt: skip
def test_smallness_is_the_friction_of_a_period_beside_the_least_swing(law: str, largest: float):
    """Forces of both masses over 2 pi / 4; the whole mass 3 times the smaller speed 0.5."""
    worm = worm_of([*UNEQUAL, f"worm.friction={law}"])
    assert worm.smallness == pytest.approx(math.pi / 2 * largest / (3 * 0.5), rel=1e-4)


def test_masses_begin_to_reverse_at_the_extremes_of_their_swings():
    """For one harmonic plus and minus the amplitudes; for two cos t + a cos 2t has four, at
    sin t = 0 and cos t = -1/(4a)."""
    worm = worm_of(UNEQUAL)
    found = np.sort(worm.extremes)
    assert found == pytest.approx([-1.0, -0.5, 0.5, 1.0], abs=1e-12)
    a = 0.8
    second = f"{{order=2, amplitude={a}, phase=[0, 180]}}"
    first = "{amplitude=1, phase=[0, 180]}"
    worm = worm_of(["worm.masses=2", f"worm.harmonic=[{first}, {second}]"])
    own = [1 + a, -1 + a, -1 / (4 * a) + a * (2 / (4 * a) ** 2 - 1)]
    own.append(own[-1])
    assert np.sort(worm.extremes) == pytest.approx(
        np.sort(np.concatenate([own, -np.array(own)])), abs=1e-9
    )


# -- scenes ----------------------------------------------------------------------------------------


@pytest.mark.compiled
def test_the_packaged_scene_reaches_its_closed_form():
    result = solved()
    top = math.sin(math.pi / 2 * 0.014 / 0.026)
    assert result.status == "ok"
    assert result.trust["warnings"] == []
    for name in ("velocity_closed_form", "velocity_steady", "velocity_steady_second"):
        assert value(result, name) == pytest.approx(top, abs=1e-13)
    assert value(result, "velocity_exact_mean") == pytest.approx(top, abs=4e-6)
    assert value(result, "averaging_error_second") < 4e-6
    assert value(result, "steady_stable") == [1]
    assert abs(value(result, "exact_drift")) < 1e-12
    assert value(result, "force_mean") == pytest.approx([0.0] * 3, abs=1e-13)
    assert value(result, "recheck_error") < 1e-11
    assert value(result, "advance") == pytest.approx(
        PERIOD * value(result, "velocity_exact_mean"), rel=1e-14
    )
    # what actuators give, friction takes
    cost = value(result, "power_mean") / value(result, "velocity_exact_mean")
    assert value(result, "energy_per_distance") == pytest.approx(cost, rel=1e-14)
    end = result["center_velocity"].values[-1]
    assert end == pytest.approx(result["center_velocity_averaged"].values[-1], abs=2e-3)
    assert sorted(result["event_contact"].values.tolist()) == [0, 0, 1, 1, 2, 2]
    # each mass a third of a period behind the one before
    swings = np.cos(2 * np.pi * (result["share"].values - np.arange(3)[:, None] / 3))
    assert result["relative_velocity"].values == pytest.approx(swings, abs=1e-13)


def test_power_is_that_of_the_averages():
    # mean of |F v| with V at its steady value: work of friction both ways, in closed form
    V, forward, backward = math.sin(math.pi / 2 * 0.014 / 0.026), 0.006, 0.02
    turn = math.acos(-V)  # forward for |t| < turn
    ahead = (V * turn + math.sin(turn)) / math.pi
    behind = ahead - V
    lost = 3 * (forward * ahead + backward * behind)
    assert value(solved(), "power_mean") == pytest.approx(lost, rel=1e-4)


def test_masses_that_reverse_at_once_go_at_half_their_amplitude():
    # at any time two go forward and one back: friction cancels, and V stays A / 2 exactly
    result = solved("worm.friction.forward=0.01")
    assert result.status == "ok"
    assert value(result, "velocity_steady") == pytest.approx(0.5, abs=1e-14)
    assert value(result, "velocity_exact_mean") == pytest.approx(0.5, abs=2e-9)
    assert value(result, "velocity_ripple") < 1e-9


# falls from 0.03 at rest to 0.001
FALLING = (
    'worm.friction={kind="stribeck", forward=0.001, backward=0.001, stick_forward=0.03, '
    "stick_backward=0.03, v_stribeck=0.8}"
)


@pytest.mark.slow
def test_friction_that_falls_with_velocity_lets_equals_go_either_way():
    ahead, back, still = (
        solved(FALLING, f"start.velocity={V}", "time.periods=2") for V in (0.1, -0.1, 0.0)
    )
    back_V, rest, ahead_V = value(ahead, "steady_velocities")
    assert value(ahead, "steady_stable") == [1, 0, 1]
    assert ahead_V == pytest.approx(-back_V, abs=1e-12)
    assert rest == pytest.approx(0.0, abs=1e-12)
    assert value(ahead, "velocity_steady") == ahead_V
    assert value(back, "velocity_steady") == back_V
    assert value(ahead, "exact_velocities")[0] == pytest.approx(back_V, abs=1e-3)
    # the mean force at the steady velocity, by another route
    law_ = Stribeck(0.001, 0.001, stick_forward=0.03, stick_backward=0.03, v_stribeck=0.8)
    force = mean_force(law_, ahead_V, np.array([1.0]), np.array([0.0]))
    assert force == pytest.approx(0.0, abs=1e-12)
    # a start on a steady velocity stays there, stable or not
    assert value(still, "velocity_steady") == rest
    assert value(still, "stable") == 0


@pytest.mark.parametrize("off", [-1e-16, 0.0, 1e-16])
def test_a_start_on_a_root_with_round_off_stays_on_it(off: float):
    steady = [Steady(-0.7, -1.0), Steady(off, 1.0), Steady(0.7, -1.0)]
    assert tends_to(0.0, steady, 1e-9) == 1
    assert tends_to(1e-6, steady, 1e-9) == 2
    assert tends_to(-1e-6, steady, 1e-9) == 0


def test_a_velocity_that_may_be_zero_is_unknown():
    # two equal masses, friction alike both ways: nothing tells forward from backward
    result = solved("worm.masses=2", "worm.harmonic.0.phase=[0, 180]", "worm.friction.forward=0.02")
    assert result.status == "ok"
    assert value(result, "velocity_steady") == pytest.approx(0.0, abs=1e-12)
    for name in ("velocity_exact_mean", "energy_per_distance", "advance"):
        assert value(result, name) is None
    assert value(result, "power_mean") > 0
    assert any("may be zero" in text for text in result.trust["warnings"])


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["not_finite", "no_periodic_motion"])
def test_an_orbit_nobody_chose_takes_no_other_with_it(monkeypatch: Patch, lost: str):
    def orbit(self: Runner, guess: float, **options: Any):
        if abs(guess) < 0.1:
            raise SolveError("none here", code=lost)
        return honest(self, guess, **options)

    honest = Runner.orbit
    monkeypatch.setattr(Runner, "orbit", orbit)
    result = solved_anew(FALLING, "start.velocity=0.1", "time.periods=2")
    assert result.status == "ok"
    back, rest, ahead = value(result, "exact_velocities")
    assert rest is None
    assert back == pytest.approx(-ahead, abs=1e-6)
    assert "center" in {variable.name for variable in result.variables}
    assert any("no exact motion was found at the steady" in t for t in result.trust["warnings"])
    # the one chosen is needed
    chosen = solved_anew(FALLING, "start.velocity=0", "time.periods=2")
    assert chosen.status == "failed"
    assert "none here" in chosen.reason
    assert "center" in {variable.name for variable in chosen.variables}


def test_without_recheck_there_is_none_and_a_warning(monkeypatch: Patch):
    def never(*given: Any, **options: Any):
        raise AssertionError

    monkeypatch.setattr("wormopt.systems.shared.proof.simulate", never)
    result = solved_anew("tolerance.recheck=false")
    assert result.status == "unchecked"
    assert value(result, "recheck_error") is None
    assert result.trust["exact"]["recheck"] is None
    assert any("tolerance.recheck is false" in text for text in result.trust["warnings"])


def test_friction_that_is_not_small_is_told_and_rests_too():
    result = solved("worm.friction={kind='coulomb', forward=0.6, backward=2.0}")
    assert result.status == "ok"
    warnings = " ".join(result.trust["warnings"])
    assert "friction is not small" in warnings
    assert "rests for 0.036 of the period" in warnings
    assert value(result, "rest_share") == pytest.approx(0.036, abs=0.001)
    assert value(result, "averaging_error_second") > 0.01


def test_a_course_that_is_too_short_is_told():
    assert any("more time.periods" in w for w in solved("time.periods=3").trust["warnings"])


@pytest.mark.slow
def test_units_and_masses_scale_the_answer():
    # velocities tenfold, frequency double, forces and masses a hundredfold: nothing else changes
    plain = solved()
    large = solved(
        'units="SI"', "worm.mass=100", "worm.frequency=2", "worm.harmonic.0.amplitude=10",
        "worm.friction.forward=12", "worm.friction.backward=40",
    )  # fmt: skip
    factors = {"velocity_exact_mean": 10, "averaging_error_second": 10, "advance": 5}
    for name, factor in factors.items():
        assert value(large, name) == pytest.approx(factor * value(plain, name), rel=1e-6)
    assert large.scalars["velocity_steady"].unit == "m s-1"
    assert large.scalars["power_mean"].unit == "W"


# -- failures --------------------------------------------------------------------------------------


def test_a_second_route_that_ends_elsewhere_fails(monkeypatch: Patch):
    def elsewhere(*given: Any, **options: Any) -> CrossCheck:
        found = honest(*given, **options)
        assert found
        return dataclasses.replace(found, error=1e-3)

    honest = steadies.cross_check
    monkeypatch.setattr(steadies, "cross_check", elsewhere)
    result = solved_anew()
    assert result.status == "failed"
    assert "ends in other states" in result.reason
    assert failed_checks(result) == ["second route"]


@pytest.mark.slow
def test_too_few_nodes_fail(tmp_path: Path):
    law = 'worm.friction={kind="stribeck", forward=0.002, backward=0.004, stick_forward=0.02, '
    law += "stick_backward=0.03, v_stribeck=0.05}"
    options = ["--set", law, "--set", "averaging.nodes=4", "--quiet", "-o", str(tmp_path / "out")]
    assert main(["run", SCENE, *options]) == 3
    result = Result.load(tmp_path / "out")
    assert result.status == "failed"
    assert "larger averaging.nodes" in result.reason
    assert "averages on twice as many nodes" in failed_checks(result)


def test_masses_that_hand_their_rest_on_go_as_the_slowest_mass():
    """Friction lets two of three masses slide forward while one rests, which each does in turn."""
    result = solved("worm.friction={kind='coulomb', forward=3.0, backward=10.0}")
    assert result.status == "ok"
    mean = 1.5 * math.sqrt(3) / math.pi  # of the largest of three cosines
    assert value(result, "velocity_exact_mean") == pytest.approx(mean, abs=1e-8)
    assert value(result, "rest_share") == pytest.approx(1 / 3, abs=1e-8)


@pytest.mark.slow
def test_masses_that_friction_stops_at_once_end_too():
    """A swing of 1e-9 is undone by friction within 1e-7 of a period: the average is stiff."""
    result = solved("worm.harmonic.0.amplitude=1e-9")
    mean = 1.5e-9 * math.sqrt(3) / math.pi  # of the largest of three cosines
    assert value(result, "velocity_exact_mean") == pytest.approx(mean, rel=1e-8, abs=0.0)
    assert value(result, "velocity_steady") == pytest.approx(
        1e-9 * math.sin(math.pi / 2 * 7 / 13), rel=1e-9, abs=0.0
    )


@pytest.mark.slow
@pytest.mark.parametrize("backward", [2e-4, 2e-6])
def test_masses_that_all_but_cease_to_reverse_are_where_averages_bend(backward: float):
    """Second order is not accurate there: a warning says so, and the motion is accepted."""
    result = solved(f"worm.friction={{kind='coulomb', forward=0.006, backward={backward}}}")
    assert result.status == "ok"
    share = 0.006 / (0.006 + backward)
    assert value(result, "velocity_steady") == pytest.approx(math.sin(math.pi * (0.5 - share)))
    assert any("averages have a corner" in line for line in result.trust["warnings"])
    assert "second order" not in result.trust["checks"]


def test_averages_that_disagree_with_the_exact_motion_fail(monkeypatch: Patch):
    def wrong(self: SlowVelocity, V: float) -> float:
        return honest(self, V) + 1e-3 * self.order

    honest = SlowVelocity.rate
    monkeypatch.setattr(SlowVelocity, "rate", wrong)
    result = solved_anew()
    assert result.status == "failed"
    assert "the closed form gives" in result.reason
    assert "exact mean velocity differs from second-order averaging" in result.reason
    assert failed_checks(result) == ["closed form", "second order"]


test_wrong_scenes_are_told = refusals(
    SCENE,
    """
    worm.harmonic.0.phase=[0, 120, 230] | worm.harmonic[0] | add up to amplitude 0.17
    worm.mass=[1, 1, 2] | worm.harmonic[0] | add up to amplitude 1 at phase -120
    worm.mass=[1, 2] | worm.mass | 2 entries for 3 masses
    worm.harmonic.0.amplitude=[1, 1] | worm.harmonic[0].amplitude | 2 entries
    worm.harmonic.0.amplitude=0 | worm.harmonic | mass 0, 1, 2 does not swing
    worm.harmonic=[{amplitude=[1, 1, 0], phase=[0, 180, 0]}] | worm.harmonic | mass 2
    worm.harmonic.1={amplitude=1, phase=[0,120,240]} | worm.harmonic
    worm.harmonic=[] | worm.harmonic | no mass swings
    worm.harmonic.0.order=6 | worm | reverse too often
    worm.friction={kind="spike"} | worm.friction | spikes do not slide back
    worm.friction.forward=0 | worm.friction | no resistance to motion forward
    worm.friction={kind="viscous", drag=0} | worm.friction | forward
    worm.friction=[{kind="viscous", drag=1}] | worm.friction | 1 entry for 3 masses
    worm.friction.stick_forward=0.001 | worm.friction.stick_forward | below the sliding
    worm.frequency=1e40 | worm.frequency | too large
    want=["motion"] | want | reversals
    """,
)


def test_an_order_is_given_once():
    wave = {"amplitude": 1, "phase": [0, 120, 240]}
    refused(SCENE, {"worm.harmonic": [wave, wave]}, "worm.harmonic[1].order", "repeats order 1")


def test_poles_are_no_roots():
    def rate(x: float) -> float:
        return (x - 0.3) / (x - 0.7) if x != 0.7 else math.inf

    found = sign_changes(rate, np.linspace(-1, 1, 50))
    assert found == pytest.approx([0.3], abs=1e-12)


def test_a_place_is_nothing_for_averages():
    model = harmonic_masses(np.cos(THIRDS), np.sin(THIRDS), law=COULOMB)
    moving = harmonic_masses(np.cos(THIRDS), np.sin(THIRDS), law=COULOMB, place=True)
    assert [s.name for s in moving.x] == ["center", "center_velocity"]
    averaged = average(model, PERIOD)
    assert [output.name for output in averaged.outputs] == []


@pytest.mark.parametrize("side", ["forward", "backward"])
def test_friction_too_large_to_be_followed_is_refused_at_once(side: str):
    """Impulse in a period, 2 pi 1e9 on each of three masses of speed 1: 2 pi 1e9 of momentum."""
    refused(SCENE, f"worm.friction.{side}=1e9", "worm.friction", "by 6.28e+09")
