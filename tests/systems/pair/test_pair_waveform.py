"""The best field of the magneto-elastic pair: theory, exact simulation, what is refused."""

import dataclasses
import math
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from outcomes import refusals, value

import wormopt as wo
from wormopt.cli import main
from wormopt.control.drive import drive
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Signal
from wormopt.ocp.problem import ramped
from wormopt.result import Result
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.pair import pair_waveform, waveform
from wormopt.systems.pair.exact import magnetic_pair
from wormopt.systems.pair.slow import steady_pair
from wormopt.systems.pair.tables import Aim, Limits
from wormopt.systems.pair.waveform import (
    FADED,
    best_harmonic,
    first_harmonic,
    orbit_from,
    push_left,
    settle,
    waveform_problem,
)

NAME, EPS = "pair_waveform_design", 0.0355
NU = math.sqrt(2) + 0.5 * EPS
WORK = 'objective={minimise="work_per_distance", speed=0.25}'
CHEAP = Aim(minimise="work_per_distance", speed=1.0)


def solved(*changes: str) -> Result:
    return wo.run(load_scene(NAME, ["want=[]", *changes]))


def pair_in(cosines: tuple[float, ...] | None, eps: float = EPS) -> Model:
    """In a field of these, or in one that is its input."""
    law = Coulomb(0.5 * eps, eps)
    return magnetic_pair(law=law, push=eps, frequency=NU, cosines=cosines)


def first_order(g1: float, detuning: float = 0.5) -> float:
    """(19) with the first harmonic g1 of the field in place of 1."""
    taken, phi = 1.5 / math.pi * math.cos(math.pi / 6), math.pi / 6
    return math.sin(phi) * math.sqrt(g1**2 / 4 - taken**2) / abs(detuning)


@pytest.fixture(scope="module")
def best() -> Result:
    return solved()


@pytest.fixture(scope="module")
def steep() -> Result:
    return solved("limits.slope=2.0")


@pytest.fixture(scope="module")
def cheap() -> Result:
    return solved(WORK)


@pytest.mark.slow
def test_the_field_that_jumps_is_fastest_and_exact_simulation_keeps_its_speed(best: Result):
    assert best.status == "unchecked"  # the law of the link is for small strains
    assert "the link changes its length by 139 %" in best.reason
    # first order in eps: the first harmonic of a field between 0 and 2 is 4 / pi at most
    assert value(best, "first_harmonic") == pytest.approx(4 / math.pi, abs=1e-4)
    assert set(np.round(best["field"].values, 9)) == {0.0, 2.0}
    assert value(best, "speed") == pytest.approx(first_order(4 / math.pi), abs=3e-4)
    assert value(best, "speed_simulated") == pytest.approx(value(best, "speed"), abs=1e-7)
    assert value(best, "recheck_error") < 1e-7
    assert best.trust["first_order_gain"] < 1e-6
    assert value(best, "drift") < 1e-7
    assert value(best, "push_left") < 0.5
    names = [check.name for check in best.checks if check.passed]
    assert names == ["simulation of the inputs found", "speed by simulation"]


@pytest.mark.slow
def test_it_beats_the_harmonic_field_on_its_periodic_orbit(best: Result):
    # mean V of (16) on its periodic orbit, by independent code
    assert value(best, "speed_harmonic") == pytest.approx(0.275727, abs=1e-6)
    assert value(best, "drift_harmonic") <= 1e-10
    assert value(best, "amplitude_harmonic") == 1.0
    assert value(best, "speed_simulated") > 1.7 * value(best, "speed_harmonic")
    ratio = value(best, "speed_simulated") / value(best, "speed_harmonic")
    assert value(best, "gain") == pytest.approx(ratio, rel=1e-12)


def test_a_link_beyond_its_own_length_is_told(best: Result):
    assert value(best, "strain_max") > 1
    assert any("masses would pass each other" in text for text in best.trust["warnings"])


def test_a_saved_waveform_moves_the_pair_again(best: Result, tmp_path: Path):
    best.save(tmp_path)
    field = wo.load_gait(tmp_path)
    pair = pair_in(None)
    # from rest: the motion tends to the same speed, wherever it starts
    orbit = settle(drive(pair, field, periodic=True), field.period, np.zeros(4))
    assert orbit.settled
    assert orbit.speed == pytest.approx(value(best, "speed"), abs=1e-8)
    times = best["instant"].values
    inner = (times[:-1] + times[1:])[np.diff(times) > 1e-6] / 2
    between = np.interp(inner, times, best["field"].values)
    assert field(inner)[0] == pytest.approx(between, abs=1e-9)


@pytest.mark.slow
def test_the_ground_takes_what_the_field_gives_and_has_no_mean_force(steep: Result):
    t, v = steep["instant"].values, steep["velocity"].values
    force = steep["contact_force"].values
    assert np.trapezoid(force.sum(axis=0), t) == pytest.approx(0.0, abs=2e-4)
    lost = -np.trapezoid((force * v).sum(axis=0), t)
    advance = value(steep, "speed") * value(steep, "time")
    assert value(steep, "work_per_distance") == pytest.approx(lost / advance, rel=1e-3)
    # every mass has to be drawn forward, at the least
    assert value(steep, "work_per_distance") > 2 * 0.5 * EPS


@pytest.mark.slow
def test_a_field_that_cannot_jump_keeps_its_slope_and_range(best: Result, steep: Result):
    assert steep.status == "unchecked"  # the law of the link is for small strains
    t, field = steep["instant"].values, steep["field"].values
    apart = np.diff(t) > 1e-6
    slopes = np.abs(np.diff(field)[apart] / np.diff(t)[apart])
    assert slopes.max() <= 2.0 + 1e-6
    assert slopes.max() == pytest.approx(2.0, abs=1e-6)
    assert field.min() >= -1e-9
    assert field.max() <= 2 + 1e-9
    assert value(steep, "speed_simulated") == pytest.approx(value(steep, "speed"), abs=1e-7)
    between = (value(steep, "speed_harmonic"), value(best, "speed"))
    assert between[0] < value(steep, "speed") < between[1]
    # still of first order in the harmonic that is left
    predicted = first_order(value(steep, "first_harmonic"))
    assert value(steep, "speed") == pytest.approx(predicted, abs=3e-3)


@pytest.mark.slow
def test_the_cheapest_field_has_its_speed_and_takes_less_work_than_a_cosine(cheap: Result):
    assert cheap.status == "ok"
    assert value(cheap, "speed_simulated") == pytest.approx(0.25, abs=1e-6)
    assert value(cheap, "speed_harmonic") == pytest.approx(0.25, abs=1e-5)
    assert value(cheap, "amplitude_harmonic") < 1
    assert value(cheap, "work_per_distance") < value(cheap, "work_per_distance_harmonic")
    assert value(cheap, "gain") > 1.02
    assert value(cheap, "objective") == pytest.approx(value(cheap, "work_per_distance"), rel=1e-6)


@pytest.mark.slow
def test_a_speed_beyond_the_field_is_refused_with_what_has_to_give_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    change = 'objective={minimise="work_per_distance", speed=0.8}'
    arguments = ["run", NAME, "-o", str(tmp_path / "out"), "--quiet", "--set", change]
    assert main([*arguments, "--set", "mesh.arcs=40"]) == 3
    assert "the smallest change that allows one is field by about 0." in capsys.readouterr().err


def test_a_pair_that_friction_holds_is_told():
    with pytest.raises(SolveError, match=r"rests in the harmonic field.*weaker friction"):
        solved("pair.friction.forward=5.0", "pair.friction.backward=10.0")


def test_a_strain_at_which_the_link_cannot_draw_is_refused_by_its_name():
    # mass 0 needs a pull above its friction 0.5 eps
    message = r"limits.strain 0.0177 allows no motion.*above 0.01775"
    with pytest.raises(SolveError, match=message) as caught:
        solved("limits.strain=0.0177")
    assert "write limits.strain above 0.01775" in caught.value.suggestion
    with pytest.raises(SolveError, match=r"above 0.0284;"):
        solved("limits.strain=0.028", "limits.field=[0.3, 2]")


def test_a_harmonic_field_that_strains_too_much_without_its_wave_is_told():
    # put on at rest, G = 1 stretches the link to eps
    found = harmonic(Limits(field=(0.0, 2.0), frequency=NU, strain=0.03))
    assert not found.kept
    assert found.amplitude == 0
    assert found.orbit.strain == pytest.approx(EPS, rel=1e-6)
    assert harmonic(Limits(field=(0.0, 2.0), frequency=NU, strain=0.05)).kept


@pytest.mark.slow
def test_a_strain_below_that_of_the_mean_field_leaves_lower_fields():
    result = solved("limits.strain=0.03", "mesh.arcs=40")
    assert result.status == "ok"
    assert value(result, "strain_max") <= 0.03 * (1 + 1e-6)
    assert value(result, "speed_simulated") == pytest.approx(value(result, "speed"), abs=1e-8)
    assert value(result, "speed") > 0.005
    assert value(result, "gain") is None
    assert any("beyond limits.strain" in text for text in result.trust["warnings"])


@pytest.mark.slow
def test_a_push_that_grows_and_a_waveform_that_is_no_better_are_told(
    monkeypatch: pytest.MonkeyPatch,
):
    def faster(*given):
        found = best_harmonic(*given)
        orbit = dataclasses.replace(found.orbit, speed=0.6)
        return dataclasses.replace(found, orbit=orbit)

    monkeypatch.setattr(waveform, "push_left", lambda *given: 1.2)
    monkeypatch.setattr(pair_waveform, "best_harmonic", faster)
    result = solved("mesh.arcs=30")
    assert any("a small push does not decay" in text for text in result.trust["warnings"])
    assert value(result, "gain") < 1
    assert any("is not faster than the harmonic" in text for text in result.trust["warnings"])


def test_a_failed_search_keeps_its_reason(monkeypatch: pytest.MonkeyPatch):
    def lost(*given, **options):
        raise SolveError("no way", code="not_solved")

    monkeypatch.setattr(waveform, "optimise_multistart", lost)
    with pytest.raises(SolveError, match="no way") as caught:
        solved()
    assert caught.value.partial.status == "failed"


# -- theory, over eps and over slopes ------------------------------------------------------------


@pytest.mark.slow
def test_speeds_tend_to_the_first_order_as_eps_falls():
    errors = []
    for eps in (0.1, 0.03, 0.01):
        nu = math.sqrt(2) + 0.5 * eps
        result = solved(f"pair.eps={eps}", f"limits.frequency={nu!r}")
        errors.append(abs(value(result, "speed_simulated") - first_order(4 / math.pi)))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-4


@pytest.mark.slow
def test_the_slower_the_field_the_slower_the_pair(best: Result, steep: Result):
    # the harmonic field itself has the slope nu = 1.43
    slopes = [value(solved(f"limits.slope={slope}"), "speed_simulated") for slope in (1.5, 5.0)]
    speeds = [slopes[0], value(steep, "speed"), slopes[1], value(best, "speed")]
    assert speeds == sorted(speeds)
    assert np.min(np.diff(speeds)) > 1e-3


@pytest.mark.slow
def test_through_the_resonance_the_strain_rules():
    result = solved("limits.frequency=[1.38, 1.5]", "limits.strain=0.8")
    assert result.status == "ok"
    assert value(result, "strain_max") <= 0.8 + 1e-6
    assert value(result, "strain_max_harmonic") <= 0.8 + 1e-6
    # V = a Omega sin(Phi), to first order, whatever the field
    swing = value(result, "swing")
    predicted = swing / 2 * value(result, "frequency") * math.sin(math.pi / 6)
    assert value(result, "speed") == pytest.approx(predicted, rel=EPS)
    assert value(result, "speed_simulated") > value(result, "speed_harmonic")


def test_a_mass_that_only_creeps_counts_as_resting():
    for speed, moves in ((1e-9, False), (1e-3, True)):
        start = np.array([0.0, EPS, speed, 0.0])  # the field stretches the link by EPS
        assert orbit_from(pair_in((1.0, 0.0)), 2 * math.pi / NU, start).moves is moves


def test_a_push_off_an_orbit_that_is_none_stays():
    pair = pair_in((1.0, 1.0))
    period = 2 * math.pi / NU
    orbit = settle(pair, period, np.zeros(4))
    size = orbit.strain
    assert push_left(pair, period, orbit.start, size) < FADED
    # a state that is not on the orbit never comes again
    beside = orbit.start * 0.3
    assert push_left(pair, period, beside, size) > 10


# -- the harmonic field --------------------------------------------------------------------------


def harmonic(limits: Limits, aim: Aim | None = None, eps: float = EPS):
    pair = pair_in((1.0, 1.0), eps)
    return best_harmonic(pair, limits, aim or Aim(maximise="speed"), lambda *given: None)


def test_the_harmonic_orbit_is_that_of_theory():
    eps = 0.003
    nu = math.sqrt(2) + 0.5 * eps
    found = harmonic(Limits(field=(0.0, 2.0), frequency=nu), eps=eps)
    assert found.orbit.settled
    assert found.orbit.speed == pytest.approx(0.280655, abs=1e-6)
    assert found.orbit.speed == pytest.approx(steady_pair(0.5, 1.0, 0.5).velocity, abs=1e-3)


def test_the_amplitude_of_the_harmonic_keeps_slope_strain_and_speed():
    found = harmonic(Limits(field=(0.0, 2.0), frequency=NU, slope=1.4))
    assert found.amplitude == pytest.approx(1.4 / NU, rel=1e-12)
    found = harmonic(Limits(field=(0.0, 2.0), frequency=NU, strain=0.6))
    assert found.amplitude < 1
    assert found.orbit.strain == pytest.approx(0.6, abs=1e-5)
    found = harmonic(Limits(field=(0.0, 2.0), frequency=NU), CHEAP.vary(speed=0.2))
    assert found.reached
    assert found.orbit.speed == pytest.approx(0.2, abs=1e-5)
    found = harmonic(Limits(field=(0.0, 2.0), frequency=NU), CHEAP.vary(speed=0.4))
    assert not found.reached


# -- parts ---------------------------------------------------------------------------------------


def test_a_ramped_plant_moves_as_the_plant_under_the_integral():
    pair = pair_in(None)
    slow = ramped(pair, 2.0)
    rate = Gait(np.array([0.0, 2.0, 4.0]), np.array([[[1.0]], [[-1.0]]]))
    level = Gait(np.array([0.0, 2.0, 4.0]), np.array([[[0.0, 1.0]], [[2.0, -1.0]]]))
    by_rate = simulate(drive(slow, rate, periodic=True), 20.0, x0={"field": 0.0})
    by_level = simulate(drive(pair, level, periodic=True), 20.0)
    assert by_rate.end[:4] == pytest.approx(by_level.end, abs=1e-9)


def test_the_first_harmonic_of_a_cosine_is_its_amplitude_and_phase():
    nu = 1.7
    wave = Gait(
        np.array([0.0, 2 * np.pi / nu]),
        np.array([[[1.0]]]),
        np.array([nu]),
        0.7 * np.array([[math.cos(0.4)]]),
        0.7 * np.array([[math.sin(0.4)]]),
    )
    assert first_harmonic(wave) == pytest.approx((0.7, 0.4), abs=1e-12)


def test_aims_and_plants_that_cannot_be_are_refused():
    with pytest.raises(ArgumentError, match="the cheapest motion is rest"):
        Aim(minimise="work_per_distance")
    pair = pair_in((1.0, 1.0))
    limits = Limits(field=(0.0, 2.0), frequency=NU)
    with pytest.raises(ArgumentError, match="cosines=None"):
        waveform_problem(pair, limits, Aim(maximise="speed"))
    u = ca.SX.sym("u", 2)
    both = Model("both", x=[Signal("x", ca.SX.sym("x", 2))], ode=u, u=[Signal("u", u)])
    with pytest.raises(ArgumentError, match="exactly one scalar input"):
        ramped(both, 1.0)


# -- scenes --------------------------------------------------------------------------------------


test_wrong_scenes_are_refused_by_their_key = refusals(
    NAME,
    """
    pair.friction.forward=1.0 | pair.friction | does not move forward
    pair.friction.forward=[0.5, 0.5, 1] | pair.friction.forward | 3 entries
    pair.friction={kind="spike"} | pair.friction.kind | write "coulomb"
    pair.friction.stick_forward=0.4 | pair.friction.stick_forward | at least that force
    limits.field=[1, 1] | limits.field | empty
    limits.frequency=[1.4, 1.5] | limits.strain | sqrt(2) = 1.41421
    limits.frequency=1.4142135623730951 | limits.strain | without bound
    limits.frequency=[0.7, 0.75] | limits.strain | harmonic 2 of the field
    limits.frequency=[0.4, 0.48] | limits.strain | sqrt(2) / 3 = 0.471405
    objective={} | objective | no objective is given; write
    objective={minimise="work_per_distance"} | objective.speed | the cheapest motion is rest
    objective={maximise="speed", speed=0.2} | objective.speed | leave it out
    units="SI" | units | "dimensionless"
    """,
)


@pytest.mark.parametrize(
    "change",
    [
        "limits.frequency=[1.42, 1.5]",
        "limits.frequency=[1.2, 1.41]",
        "limits.frequency=[0.72, 0.75]",
        "limits.frequency=[0.5, 0.7]",
    ],
)
def test_ranges_without_a_resonance_are_read(change: str):
    low, high = load_scene(NAME, [change]).table.limits.frequencies
    assert not any(low <= math.sqrt(2) / k <= high for k in range(1, 10))
