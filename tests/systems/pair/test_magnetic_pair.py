"""The magneto-elastic pair: (19), exact motions, orders of averaging; scenes of its kinds."""

import math
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from outcomes import refusals, run_text, told_by_a_run, value

import wormopt as wo
from wormopt.analysis.average import average
from wormopt.analysis.steady import Rates, steady_states
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
from wormopt.numerics.newton import newton
from wormopt.progress import silent
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.pair.exact import magnetic_pair, scaled_law
from wormopt.systems.pair.slow import averaged_pair, from_slow, slow_pair, steady_pair
from wormopt.systems.pair.steady import Pair, Points, confirm

NATURAL = math.sqrt(2)
# docs/verification.md: steady motion (19) at the chapter's data, and exact mean velocities.
STEADY = (0.28110586, 0.39754371, 2.16785411)
EXACT = {0.003: 0.280655, 0.01: 0.279601, 0.0355: 0.275727}


def numbers(eps: float) -> dict[str, object]:
    return {"law": Coulomb(0.5 * eps, 1.0 * eps), "push": eps, "frequency": NATURAL + 0.5 * eps}


@pytest.mark.parametrize(
    "law", [Coulomb(1.0, 2.0, 1.5), Stribeck(1.0, 2.0, 1.5, 4.0, 0.3), Viscous(2.0), Spike(3.0)]
)
def test_a_scaled_law_has_scaled_forces_at_scaled_velocities(law: Law):
    push, speed, v, width = 0.5, 4.0, 0.25, 0.125  # powers of two
    scaled = scaled_law(law, push, speed)
    assert scaled.stick_interval == tuple(push * force for force in law.stick_interval)
    for way in law.directions:
        force = push * float(law.slip_force(way * v, way))
        assert float(scaled.slip_force(speed * way * v, way)) == pytest.approx(force, rel=1e-14)
    smooth = push * float(law.smooth(-v, width))
    assert float(scaled.smooth(-speed * v, speed * width)) == pytest.approx(smooth, rel=1e-14)


@cache
def steady_velocity(eps: float, order: int) -> float:
    slow = slow_pair(**numbers(eps))  # type: ignore[arg-type]
    model = average(slow, 2 * math.pi / (NATURAL + 0.5 * eps), order=order)  # type: ignore[arg-type]
    rates, closed = Rates(model), steady_pair(0.5, 1.0, 0.5)
    swing = closed.amplitude * np.array([math.cos(closed.lag), math.sin(closed.lag)])
    x, found = newton(rates, np.array([[closed.velocity, *swing]]), rates.parameters(None))
    assert found.all()
    return float(x[0, 0])


@cache
def exact_velocity(eps: float) -> float:
    """Displacement over whole periods after t = 60 / eps, from near the steady motion on."""
    nu, closed = NATURAL + 0.5 * eps, steady_pair(0.5, 1.0, 0.5)
    swing = closed.amplitude * np.array([math.cos(closed.lag), math.sin(closed.lag)])
    begin, length = 60 / eps, 20 * 2 * math.pi / nu
    motion = simulate(
        magnetic_pair(**numbers(eps)),  # type: ignore[arg-type]
        begin + length,
        x0=from_slow(0.0, closed.velocity, swing, frequency=nu),
        times=[begin, begin + length],
    )
    return float(np.diff(motion["center"][0])[0] / length)


# -- (19) and the exact motion ---------------------------------------------------------------------


def test_the_steady_motion_at_the_chapters_data():
    closed = steady_pair(0.5, 1.0, 0.5)
    assert (closed.velocity, closed.amplitude, closed.lag) == pytest.approx(STEADY, abs=5e-9)


def test_the_averaged_motion_from_rest_settles_on_it():
    model = averaged_pair(**numbers(0.0355))  # type: ignore[arg-type]
    motion = simulate(model, 80 / 0.0355)
    amplitude, lag = motion["amplitude"][0, -1], motion["lag"][0, -1]
    closed = steady_pair(0.5, 1.0, 0.5)
    found = (motion.end[0], amplitude, lag)
    assert found == pytest.approx((closed.velocity, closed.amplitude, closed.lag), abs=1e-9)


@pytest.mark.parametrize("eps", EXACT)
def test_exact_mean_velocities(eps: float):
    assert exact_velocity(eps) == pytest.approx(EXACT[eps], abs=2e-6)


def test_errors_of_averaging_fall_with_their_order():
    sizes = np.array([0.0025, 0.005, 0.01, 0.02])
    exact = np.array([exact_velocity(eps) for eps in sizes])
    for order, ceiling in ((1, 0.16), (2, 0.07)):
        errors = np.abs([steady_velocity(eps, order) for eps in sizes] - exact)
        slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
        assert order - 0.1 < slope < order + 0.1
        assert (errors < ceiling * sizes**order).all()


def test_the_first_error_is_what_theory_names():
    """0.150 eps at the chapter's data: what the second order takes away."""
    eps = 1e-3
    taken = steady_velocity(eps, 1) - steady_velocity(eps, 2)
    assert taken / eps == pytest.approx(0.150, abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.8, 0.8, 0.5), "takes E cos"),
        ((0.5, 1.0, 0.0), "detuning 0"),
        ((0.0, 0.0, 0.5), "above 0"),
    ],
)
def test_what_19_does_not_cover_is_refused(arguments, message: str):
    with pytest.raises(ArgumentError, match=message):
        steady_pair(*arguments)


def test_a_border_of_existence_is_no_steady_motion():
    """E cos(Phi) = 1/2 exactly would be a = 0; just below, the swing is small."""
    size = math.pi / 4  # F+ = F- = size: E cos(Phi) = 2 size / pi
    with pytest.raises(ArgumentError, match="no steady motion"):
        steady_pair(size, size, 1.0)
    assert steady_pair(size * (1 - 1e-12), size * (1 - 1e-12), 1.0).amplitude < 1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"push": 0.0}, "push must be positive"),
        ({"law": [Coulomb(0.1, 0.2)]}, "law has 1 entries"),
        ({"law": "dry"}, "not a friction law"),
        ({"cosines": (1.0, math.inf)}, "finite numbers"),
    ],
)
def test_pairs_that_cannot_be_are_refused(change, message: str):
    with pytest.raises(ArgumentError, match=message):
        magnetic_pair(**(numbers(0.01) | change))  # type: ignore[arg-type]


# -- kind magnetic-pair ----------------------------------------------------------------------------


UNCHECKED = "tolerance.recheck=false"


@pytest.mark.slow
def test_figure_13():
    result = wo.run("fig13_magnetic_pair")
    assert result.status == "ok"
    found = [value(result, f"{name}_steady") for name in ("velocity", "amplitude", "phase")]
    assert found == pytest.approx(STEADY, abs=5e-9)
    assert value(result, "natural_rate") == pytest.approx(31.804, abs=5e-4)
    assert value(result, "velocity_steady_si") == pytest.approx(0.2593, abs=5e-5)
    assert value(result, "velocity_exact_mean") == pytest.approx(EXACT[0.0355], abs=2e-6)
    assert value(result, "averaging_error_second") < 0.02 * value(result, "averaging_error")
    assert value(result, "stable")
    assert value(result, "u0") == 0.071
    assert result.trust["settled_to"] < 1e-9
    assert result.trust["closed_form_difference"] < 1e-12
    assert result.trust["quadrature_error"] < 1e-13
    assert [check.name for check in result.checks] == ["closed form (19)", "second route"]
    assert all(check.passed for check in result.checks)
    # the chapter's velocity is shown as a discrepancy
    assert value(result, "velocity_stated_deviation") == pytest.approx(0.29 - 0.2593, abs=5e-5)
    assert any(
        "stated velocity 0.29 agrees neither" in warning for warning in result.trust["warnings"]
    )


@pytest.mark.slow
def test_signals_of_figure_13_are_in_its_units_and_strains_are_not_small():
    # half the points of quadrature, which is as exact; slow tests look at the second route
    result = wo.run(load_scene("fig13_magnetic_pair", [UNCHECKED, "averaging.nodes=8"]))
    assert any("small strains" in warning for warning in result.trust["warnings"])
    assert (result["time"].unit, result["velocity"].unit) == ("s", "m s-1")
    last = result["velocity_first"].values[-1]
    assert last == pytest.approx(value(result, "velocity_steady_si"), abs=1e-9)
    mean = result["velocity_period"].values
    assert np.isnan(mean[0])
    assert mean[-50] == pytest.approx(value(result, "velocity_exact_mean_si"), abs=1e-6)
    periods = np.ptp(result["late_time"].values) * value(result, "frequency") / (2 * math.pi)
    assert periods == pytest.approx(4.0)


STRIBECK = (
    'pair.friction={kind="stribeck", forward=0.3, backward=0.6, stick_forward=0.9, '
    "stick_backward=1.8, v_stribeck=0.15}"
)
PAIR = """schema = 1
kind = "magnetic-pair"
detuning = 0.5
[pair]
eps = 0.05
friction = {kind = "coulomb", forward = 0.5, backward = 1.0}
[averaging]
nodes = 8
[time]
periods = 4
"""


@pytest.mark.slow
def test_weaker_friction_backward_moves_the_pair_backward(tmp_path: Path):
    friction = 'pair.friction={kind="coulomb", forward=1.0, backward=0.5}'
    result = run_text(tmp_path, PAIR, friction, UNCHECKED)
    there = run_text(tmp_path, PAIR, UNCHECKED)
    assert value(result, "velocity_steady") == pytest.approx(-value(there, "velocity_steady"))
    assert value(result, "velocity_exact_mean") == pytest.approx(
        -value(there, "velocity_exact_mean"), abs=1e-6
    )
    assert any("backward" in warning for warning in result.trust["warnings"])


@pytest.mark.slow
def test_a_pair_with_friction_alike_both_ways_moves_neither_way(tmp_path: Path):
    """Its velocity is 0 but for rounding, which has a sign."""
    friction = 'pair.friction={kind="coulomb", forward=0.5, backward=0.5}'
    result = run_text(tmp_path, PAIR, friction, UNCHECKED)
    assert abs(value(result, "velocity_steady")) < 1e-12
    assert not [text for text in result.trust["warnings"] if "backward" in text]


def test_a_motion_that_settles_slowly_is_followed_longer(tmp_path: Path):
    result = run_text(tmp_path, PAIR, "detuning=0.1", UNCHECKED)
    closed = steady_pair(0.5, 1.0, 0.1)
    assert result.status == "unchecked"
    assert result.trust["settled_to"] < 1e-9
    assert value(result, "velocity_steady") == pytest.approx(closed.velocity, rel=1e-12)
    assert value(result, "velocity_exact_mean") == pytest.approx(closed.velocity, rel=1e-2)


@pytest.mark.parametrize(
    ("end", "status"), [(100.0, "unchecked"), pytest.param(900.0, "ok", marks=pytest.mark.slow)]
)
def test_a_steady_state_that_no_motion_comes_near_is_unchecked(
    tmp_path: Path, end: float, status: str
):
    # deviations fade like exp(-0.41 eps t): to 0.44 at 100, to 6e-4 at 900
    change = ["pair.eps=0.02", f"time.end={end}", "time.periods=3"]
    result = run_text(tmp_path, PAIR, *change)
    assert result.status == status
    assert any("away from the steady state" in text for text in result.trust["warnings"])


def test_a_field_of_the_other_sign_swings_half_a_turn_later(tmp_path: Path):
    result = run_text(tmp_path, PAIR, "pair.cosines=[1.0, -1.0]", UNCHECKED)
    assert value(result, "velocity_steady") == pytest.approx(STEADY[0], abs=5e-9)
    assert value(result, "phase_steady") == pytest.approx(STEADY[2] - math.pi, abs=5e-9)
    assert result.trust["closed_form_difference"] < 1e-12


def test_a_pair_that_friction_holds_at_rest_is_told(tmp_path: Path):
    with pytest.raises(SolveError, match="cannot be simulated from rest"):
        run_text(tmp_path, PAIR, STRIBECK)


def test_a_large_eps_is_warned_of(tmp_path: Path):
    result = run_text(tmp_path, PAIR, "pair.eps=0.2", UNCHECKED)
    assert any("eps = 0.2 is not small" in warning for warning in result.trust["warnings"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["detuning=0.0"], "at detuning 0"),
        (["pair.friction.forward=0.8", "pair.friction.backward=0.8"], "friction takes E cos"),
    ],
)
def test_pairs_without_steady_motion_fail_with_the_reason(
    tmp_path: Path, changes: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "scene.toml"
    path.write_text(PAIR)
    changes = [*changes, "averaging.nodes=4"]
    code, printed = told_by_a_run(capsys, path, tmp_path / "out", *changes)
    assert (code, printed["status"]) == (3, "failed")
    assert message in printed["reason"]


test_bad_pairs_are_refused = refusals(
    PAIR,
    """
    units="SI" | pair.sample | missing
    pair.cosines=[1.0] | pair.cosines | 2 to 13
    pair.cosines=[1.0, 0.0] | pair.cosines | second number 0
    pair.friction={kind="spike"} | pair.friction | do not slide back
    pair.friction.stick_forward=0.1 | pair.friction.stick_forward | stiction is below
    detuning=-27.0 | detuning | = 0.06421, which is not above 0.1
    time.end=1.0 | time.end | twice time.periods
    pair.friction.forward=0.0 | pair.friction | no resistance to motion forward
    pair.friction={kind="viscous", drag=0.0} | pair.friction | no resistance
    """,
)


# -- kind resonance --------------------------------------------------------------------------------

SWEEP = """schema = 1
kind = "resonance"
[pair]
eps = 0.0355
friction = {kind = "coulomb", forward = 0.5, backward = 1.0}
[frequencies]
detuning = [-1.0, 1.0]
points = 20
"""


def test_both_branches_are_those_of_19(tmp_path: Path):
    # a search at the detuning 0.26 finds a swing of 0.76
    result = run_text(tmp_path, SWEEP, "frequencies.points=4", "frequencies.largest=0.7")
    assert value(result, "branches") == 2
    assert value(result, "delta_fold") == []
    assert value(result, "stable") == 4
    for detuning, velocity, amplitude in zip(
        *(result[name].values for name in ("detuning", "velocity_steady", "amplitude_steady")),
        strict=True,
    ):
        closed = steady_pair(0.5, 1.0, detuning)
        assert (velocity, amplitude) == pytest.approx(
            (closed.velocity, closed.amplitude), rel=1e-12
        )
    told = "the swing of 2 branches exceeds frequencies.largest = 0.7 lengths"
    assert any(told in warning for warning in result.trust["warnings"])


def test_exact_motions_confirm_the_branches(tmp_path: Path):
    result = run_text(tmp_path, SWEEP, "confirm.time=1200.0", "frequencies.points=2")
    assert value(result, "confirmed") == 2
    assert value(result, "averaging_error") < 0.2 * 0.0355
    assert value(result, "averaging_error_second") < 0.1 * value(result, "averaging_error")
    assert result["velocity_exact"].values == pytest.approx(
        result["velocity_second"].values, abs=2e-3
    )


@pytest.mark.slow
def test_folds_of_a_resonance(tmp_path: Path):
    result = run_text(tmp_path, SWEEP, STRIBECK, "frequencies.detuning=[0.3, 3.0]")
    (fold,) = value(result, "delta_fold")
    around = ["frequencies.detuning=[-3.0, 3.0]", "frequencies.points=2"]
    with pytest.raises(SolveError, match="no branch has a steady motion at the 2 detunings"):
        run_text(tmp_path, SWEEP, STRIBECK, *around)
    assert result["detuning"].values.max() < fold < 3.0
    assert value(result, "steady_motions") > value(result, "stable") > 0
    eps = 0.0355
    law = wo.Stribeck(0.3 * eps, 0.6 * eps, 0.9 * eps, 1.8 * eps, 0.15)
    slow = slow_pair(law=law, push=0.0355, frequency=NATURAL)
    nu = next(s.symbol for s in slow.p if s.name == "frequency")
    model = average(slow, 2 * ca.pi / nu)
    for side, count in ((0.01, 0), (-0.01, 2)):
        frequency = NATURAL + 0.0355 * (fold + side)
        box = {"center_velocity": (-1.0, 1.0), "swing": (-1.0, 1.0)}
        assert len(steady_states(model, box, p={"frequency": frequency}, starts=300)) == count


def test_without_stable_points_no_exact_motion_is_simulated():
    laws = Coulomb(0.5, 1.0), Coulomb(0.5, 1.0)
    saddle = Points(np.zeros(1), np.ones((1, 3)), np.zeros(1, bool), np.zeros(1), np.ones(1))
    exact = confirm(Pair(0.01, laws, (1.0, 1.0), 4), saddle, 100.0, 5, wo.Tolerance(), silent)
    assert np.isnan(exact.velocity).all()
    assert not exact.settled.any()


@pytest.mark.slow
def test_branches_that_begin_where_stability_changes_are_followed(tmp_path: Path):
    """Alike both ways, friction that falls with velocity lets V = 0 branch off to both sides."""
    friction = (
        'pair.friction={kind="stribeck", forward=0.1, backward=0.1, stick_forward=0.5, '
        "stick_backward=0.5, v_stribeck=0.3}"
    )
    result = run_text(
        tmp_path, SWEEP, friction, "frequencies.detuning=[0.3, 3.0]", "frequencies.points=28"
    )
    assert value(result, "branches") > 1
    detuning, stable = result["detuning"].values, result["stable_point"].values > 0
    near = np.abs(detuning - 1.1) < 1e-9
    velocities = np.sort(result["velocity_steady"].values[near & stable])
    assert len(velocities) == 2
    assert velocities[0] == pytest.approx(-velocities[1], abs=1e-9)
    assert velocities[1] > 0.1


test_bad_sweeps_are_refused = refusals(
    SWEEP,
    """
    frequencies.detuning=[1.0, -1.0] | frequencies.detuning
    frequencies.detuning=[1.0, 1.0] | frequencies.detuning
    frequencies.detuning=[-50.0, 1.0] | frequencies.detuning
    confirm.time=10.0 | confirm.time
    """,
)


def test_a_sweep_without_steady_motion_fails(tmp_path: Path):
    friction = ["pair.friction.forward=0.9", "pair.friction.backward=0.9"]
    with pytest.raises(SolveError, match="friction takes E cos"):
        run_text(tmp_path, SWEEP, *friction, "averaging.nodes=4")


@pytest.mark.slow
def test_the_packaged_resonance_is_confirmed_at_400_points():
    result = wo.run(load_scene("resonance_curve"))
    assert result.status == "ok"
    assert value(result, "confirmed") == 400
    assert value(result, "averaging_error") < 0.2 * 0.0355
    away = np.abs(result["detuning"].values) > 0.1
    late = np.abs(result["velocity_second"].values - result["velocity_exact"].values)[away]
    assert np.nanmax(late) < 0.25 * 0.0355**2
