"""What a trajectory keeps where no times are named, and samples at its very end."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal, Switch
from wormopt.model.schedule import Delay
from wormopt.simulation import simulate as simulating
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.gradient import gradient
from wormopt.simulation.options import Route, Smooth
from wormopt.simulation.simulate import simulate
from wormopt.simulation.steps import Kept

ROUTES: tuple[Route, ...] = ("native", "python", "radau")
t, x, v, f = (ca.SX.sym(name) for name in "txvf")


def swing(rate: float) -> Model:
    """x = sin(rate t)."""
    states = [Signal("x", x, value=0.0), Signal("v", v, value=rate)]
    return Model("swing", x=states, ode=ca.vertcat(v, -(rate**2) * x))


def block(push: ca.SX | float, speed: float = 1.0) -> Model:
    states = [Signal("x", x, value=0.0), Signal("v", v, value=speed)]
    ground = [Contact("block", v, f, Coulomb(1.0, 2.0))]
    return Model("block", x=states, ode=ca.vertcat(v, f + push), t=t, contacts=ground)


# -- steps that are kept -----------------------------------------------------------------------


@pytest.mark.parametrize("route", ROUTES)
def test_without_times_the_ends_of_all_steps_are_kept(route: Route):
    motion = simulate(swing(1.0), 3.0, route=route)
    assert len(motion.time) == motion.n_steps + 1
    assert motion.time[[0, -1]].tolist() == [0.0, 3.0]
    assert np.all(np.diff(motion.time) > 0)
    assert motion["x"][0] == pytest.approx(np.sin(motion.time), abs=1e-9)
    assert motion.states[:, -1].tolist() == motion.end.tolist()


def test_what_is_kept_changes_no_step_and_none_is_kept_on_request():
    whole, nothing = simulate(swing(1.0), 30.0), simulate(swing(1.0), 30.0, times=[])
    assert nothing.time.shape == (0,)
    assert nothing.end.tolist() == whole.end.tolist()
    assert nothing.n_steps == whole.n_steps


@pytest.mark.parametrize("route", ROUTES)
def test_largest_values_and_pictures_are_those_of_the_steps(route: Route):
    """A block thrown up a slope that turns: two instants would tell of no way at all."""
    motion = simulate(block(-3.0), 2.0, route=route)
    assert motion["x"].max() == pytest.approx(0.125, abs=1e-4)
    turn = motion.events[0].time
    assert turn == pytest.approx(0.25, abs=1e-9)
    assert np.abs(motion.time - turn).min() == 0  # a step ends there


def test_states_at_events_are_those_behind_them_and_so_are_modes(route: Route):
    up = Switch("kick", t - 1, ca.vertcat(x, 5))
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.0)]
    model = Model("kicked", states, ca.vertcat(v, 0), t=t, switches=[up])
    motion = simulate(model, 2.0, route=route)
    assert motion["v"][0] == pytest.approx(np.where(motion.time < motion.events[0].time, 0, 5))
    assert motion["x"][0, -1] == pytest.approx(5.0)


@settings(max_examples=examples(50))
@given(most=st.integers(1, 20).map(lambda half: 2 * half), count=st.integers(0, 500))
def test_rows_are_thinned_out_evenly(most: int, count: int):
    kept = Kept(most)
    for k in range(count):
        kept.add(float(k), np.array([10.0 * k]))
    rows = np.array(kept.rows).reshape(-1, 2)
    stride = next(2**i for i in range(10) if count <= 2**i * (most - 1))
    assert rows[:, 0].tolist() == list(range(0, count, stride))
    assert rows[:, 1].tolist() == (10 * rows[:, 0]).tolist()


def test_memory_is_bounded_whatever_the_span(route: Route, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(simulating, "_KEPT", 64)
    monkeypatch.setattr(simulating, "_LEAST_KEPT", 64)
    short, long = (simulate(swing(1.0), end, route=route) for end in (5.0, 300.0))
    assert short.n_steps < 64 < 10 * 64 < long.n_steps
    assert len(short.time) == short.n_steps + 1
    assert 32 <= len(long.time) <= 65
    assert long.time[[0, -1]].tolist() == [0.0, 300.0]
    assert long["x"][0] == pytest.approx(np.sin(long.time), abs=1e-8)


@pytest.mark.parametrize("size", [1, 300, 10**6])
def test_many_states_are_kept_less_often(size: int):
    most = simulating._most_kept(size)
    assert most % 2 == 0
    assert 200 <= most <= 10_000
    assert most * size <= 2_000_000 or most == 200


@pytest.mark.parametrize("route", ROUTES)
def test_what_is_kept_is_every_so_many_th_step(route: Route, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(simulating, "_KEPT", 50)
    monkeypatch.setattr(simulating, "_LEAST_KEPT", 50)
    motion = simulate(block(2.5 * ca.sin(3 * t)), 3.0, dense=True, route=route)
    assert motion.dense is not None
    steps = motion.dense.time
    stride = next(2**i for i in range(10) if len(steps) - 1 <= 2**i * 49)
    assert motion.time.tolist() == [*steps[:-1:stride], steps[-1]]


def test_implicit_integrators_keep_the_motion_too():
    motion = simulate(block(2.5 * ca.sin(3 * t)), 2.0, contact=Smooth(0.1), route="cvodes")
    same = simulate(block(2.5 * ca.sin(3 * t)), 2.0, contact=Smooth(0.1), times=motion.time)
    assert len(motion.time) == 513
    assert motion.states == pytest.approx(same.states, abs=1e-7)


def test_delay_equations_keep_all_stretches(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(simulating, "_KEPT", 100)
    past = ca.SX.sym("past")
    delays = [Delay("past", past, x, lag=1.0)]
    model = Model("lagging", [Signal("x", x, value=1.0)], -past, delays=delays)
    motion = simulate(model, 3.0)
    assert 50 <= len(motion.time) <= 101
    first = motion.time <= 1
    assert motion["x"][0, first] == pytest.approx(1 - motion.time[first], abs=1e-10)
    assert motion.time[[0, -1]].tolist() == [0.0, 3.0]


def test_members_of_an_ensemble_share_their_instants():
    members = [Scenario(x0={"v": speed}) for speed in (0.5, 1.0)]
    herd = simulate_ensemble(block(0.0), 3.0, members)
    assert herd.time.tolist() == [0.0, 3.0]
    assert herd.end[:, 0] == pytest.approx([0.125, 0.5], abs=1e-10)


def test_derivatives_are_kept_with_their_states():
    rate = ca.SX.sym("rate")
    numbers = [Signal("rate", rate, value=1.0)]
    decay = Model("decay", [Signal("x", x, value=1.0)], -rate * x, p=numbers)
    motion = simulate(decay, 2.0, sensitivities=["rate"])
    assert motion.derivative("x")[0, 0] == pytest.approx(
        -motion.time * np.exp(-motion.time), abs=1e-9
    )


def test_a_gradient_of_the_end_needs_no_more_than_the_end():
    motion = simulate(swing(1.0), 2.0, dense=True)
    assert len(motion.time) > 2
    found = gradient(motion, {"x": [1.0]}).x0
    assert [found["x"][0], found["v"][0]] == pytest.approx([np.cos(2), np.sin(2)], abs=1e-9)
    weights = np.zeros((1, len(motion.time)))
    weights[0, -1] = 1.0
    assert gradient(motion, {"x": weights}).x0["v"] == pytest.approx(found["v"], abs=1e-12)


# -- samples at the end of a motion --------------------------------------------------------------


def clock(end: float, rate: float = 1.0) -> Model:
    """A state that goes by rate until a switch ends the motion at a time."""
    stop = [Switch("stop", x - rate * end, x, terminal=True)]
    return Model("clock", x=[Signal("x", x, value=0.0)], ode=ca.SX(rate), t=t, switches=stop)


@pytest.mark.parametrize("route", ROUTES)
def test_a_sample_at_the_instant_of_the_last_event_is_there(route: Route):
    motion = simulate(clock(0.5), 1.0, times=[0, 0.5, 1], dense=True, route=route)
    assert motion.time.tolist() == [0, 0.5]
    assert motion["x"][0] == pytest.approx([0, 0.5], abs=1e-12)
    assert motion.at(np.array([0.25, 0.5]))["x"][0] == pytest.approx([0.25, 0.5], abs=1e-12)
    with pytest.raises(ValueError, match=r"times must be from 0 to 0\.5"):
        motion.at(np.array([0.5 + 1e-6]))


@settings(max_examples=examples(15))
@given(
    end=st.floats(0.01, 0.99), rate=st.floats(0.01, 100.0), start=st.sampled_from([0.0, 7.0, -3.0])
)
def test_so_it_is_at_any_instant(end: float, rate: float, start: float):
    times: Any = start + np.array([0.0, end, 1.0])
    motion = simulate(
        clock(end, rate), (start, start + 1.0), times=times, dense=True, route="python"
    )
    assert motion.time.tolist() == times[:2].tolist()
    assert motion["x"][0, -1] == pytest.approx(rate * end, rel=1e-9)
    assert motion.at(times[1:2])["x"][0] == pytest.approx([rate * end], rel=1e-9)


def test_samples_clearly_beyond_the_last_event_are_not_made_up():
    assert simulate(clock(0.5), 1.0, times=[0.4, 0.5 + 1e-6, 1]).time.tolist() == [0.4]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="address space is limited by Linux")
def test_a_chain_with_a_million_samples_runs_in_little_memory(tmp_path: Path):
    limited = "import resource, runpy, sys; size = 1_500_000_000;"
    limited += "resource.setrlimit(resource.RLIMIT_AS, (size, size));"
    limited += (
        "sys.argv = ['wormopt', *sys.argv[1:]]; runpy.run_module('wormopt', run_name='__main__')"
    )
    run = ["run", "spiked_chain", "-o", str(tmp_path / "out"), "--quiet"]
    result = subprocess.run(
        [sys.executable, "-c", limited, *run, "--set", "time.samples=1000000", "--set", "want=[]"],
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stderr
