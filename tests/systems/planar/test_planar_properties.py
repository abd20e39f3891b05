"""What holds for all worms in the plane: random ones on random ground."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from places import DOCS
from shapes import rotated

from wormopt.model.friction import Coulomb, NoSlip
from wormopt.model.model import Model, pack
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.planar.dynamics.chain import Axes, chain_places, planar_chain
from wormopt.systems.planar.dynamics.motion import (
    closed_link,
    energy_error,
    step_again,
    stepper_of,
    swing,
    watch_links,
)
from wormopt.systems.planar.shape import Harmonics
from wormopt.systems.shared.models import measure_works

GROUNDS = ("elliptic", "unit", "box", "skid")
PERIOD, END = 2.5, 1.5


@dataclass(frozen=True)
class Worm:
    """A worm, what drives it, and how it starts."""

    numbers: dict[str, Any]
    law: Any
    force: np.ndarray  # (2, n) of cosine and sine
    torque: np.ndarray  # (2, n - 1)
    places: np.ndarray  # (n + 1, 2)
    velocities: np.ndarray

    @property
    def links(self) -> int:
        """Number of links."""
        return len(self.places) - 1

    def model(self) -> Model:
        """With its inputs."""
        start: dict[str, Any] = {"position": self.places, "velocity": self.velocities}
        worm = planar_chain(self.links, **self.numbers, law=self.law, **start)
        given = {k: v for k, v in (("input", self.force), ("torque", self.torque)) if v.size}
        waves = {k: Harmonics(np.zeros(v.shape[1]), v[:1], v[1:]) for k, v in given.items()}
        return swing(worm, PERIOD, waves)


def law_of(ground: str, rng: np.random.Generator) -> Any:
    """Ground that resists ahead, back and aside differently."""
    ahead, back, aside = rng.uniform(0.2, 1.5, 3).tolist()
    return {
        "elliptic": Elliptic(ahead, back, aside),
        "unit": AnisotropicCoulomb(ahead, back, aside),
        "box": Axes(Coulomb(ahead, back), Coulomb(aside, aside)),
        "skid": Axes(Coulomb(ahead, back), NoSlip()),
    }[ground]


def draw(n: int, ground: str, seed: int) -> Worm:
    """A worm that starts at rest."""
    rng = np.random.default_rng(seed)
    numbers = {
        name: rng.uniform(low, high, size)
        for name, low, high, size in (
            ("mass", 0.5, 2, n + 1), ("stiffness", 5, 15, n), ("damping", 0.3, 2, n),
            ("rest_length", 0.8, 1.2, n), ("bending_stiffness", 1, 4, n - 1),
            ("bending_damping", 0.1, 1, n - 1),
        )
    }  # fmt: skip
    places = chain_places(numbers["rest_length"], rng.uniform(-0.5, 0.5, n - 1))
    torque = rng.uniform(-1.5, 1.5, (2, n - 1))
    law, force = law_of(ground, rng), rng.uniform(-5, 5, (2, n))
    return Worm(numbers, law, force, torque, places, np.zeros_like(places))


WORMS = st.builds(draw, st.integers(1, 4), st.sampled_from(GROUNDS), st.integers(0, 10**6))


def end_of(worm: Worm) -> tuple[np.ndarray, list[tuple[str, str]], np.ndarray]:
    """Places at the end; names and kinds of events, and their times."""
    motion = followed(worm.model())
    told = [(e.name, e.kind) for e in motion.events]
    return motion["position"][:, -1].reshape(-1, 2), told, np.array([e.time for e in motion.events])


def followed(model: Model, **options: Any) -> Trajectory:
    """The motion of a worm whose links stay open."""
    motion = simulate(watch_links(model, 1e-2), END, route="python", **options)
    assume(not closed_link(motion))
    return motion


@pytest.mark.slow
@settings(max_examples=examples(10))
@given(WORMS, st.floats(-3.1, 3.1), st.tuples(st.floats(-9, 9), st.floats(-9, 9)))
def test_nothing_knows_where_x_points(worm: Worm, angle: float, shift: Any) -> None:
    """A worm that starts elsewhere and turned goes the same way, by the same events."""
    moved = replace(worm, places=rotated(worm.places, angle) + shift)
    (a, told, when), (b, again, later) = end_of(worm), end_of(moved)
    assert_allclose(rotated(a, angle) + shift, b, rtol=0, atol=1e-8)
    assert told == again
    assert_allclose(when, later, rtol=0, atol=1e-7)


@pytest.mark.slow
@settings(max_examples=examples(10))
@given(WORMS)
def test_left_and_right_are_alike(worm: Worm) -> None:
    """The mirrored worm goes the mirrored way."""
    flip = [1.0, -1.0]
    moved = replace(worm, places=worm.places * flip, torque=-worm.torque)
    (a, told, _), (b, again, _) = end_of(worm), end_of(moved)
    assert_allclose(a * flip, b, rtol=0, atol=1e-8)
    assert [kind for _, kind in told] == [kind for _, kind in again]


@pytest.mark.slow
@settings(max_examples=examples(10))
@given(WORMS, st.booleans())
def test_energy_and_momentum_balance(worm: Worm, rods: bool) -> None:
    """Works are energy gained; the ground and nothing else moves the centre and turns the worm."""
    if rods:
        worm = replace(worm, numbers={**worm.numbers, "rod_mass": 0.3})
    motion = followed(measure_works(worm.model(), 1.0), times=np.linspace(0, END, 41))
    assert energy_error(motion, "energy") < 1e-8
    assert motion["ground_work"][0, -1] <= 1e-12
    if rods:
        return
    model, points = motion.system.model, worm.links + 1
    names = "position", "velocity", "ground_force"
    r, v, F = (ca.reshape(model[name], 2, points) for name in names)
    mass = ca.DM(worm.numbers["mass"]).T
    spin = ca.sum2(mass * (r[0, :] * v[1, :] - r[1, :] * v[0, :]))
    momentum = ca.vertcat(ca.sum2(ca.repmat(mass, 2, 1) * v), spin)
    moment = ca.sum2(r[0, :] * F[1, :] - r[1, :] * F[0, :])
    gained = ca.jtimes(momentum, pack(model.x), model.ode)
    gap = gained - ca.vertcat(ca.sum2(F), moment)
    assert np.abs(motion.observe(gap)).max() < 1e-10


@pytest.mark.slow
@settings(max_examples=examples(15))
@given(st.integers(1, 4), st.sampled_from(["elliptic", "box"]), st.integers(0, 10**6))
def test_steps_that_know_no_events_come_nearer_at_first_order(
    n: int, ground: str, seed: int
) -> None:
    """A random worm by events against steps of Moreau and Jean."""
    model = draw(n, ground, seed).model()
    motion = followed(model, times=np.linspace(0, END, 101))
    stepper = stepper_of(model)
    assert stepper is not None
    found = step_again(stepper, motion, step=4e-4)
    assert found.fine < 1e-3
    # nearer than a quarter of a step, how stops lie between steps decides
    assert found.fine < max(0.5 * found.coarse, 0.25 * found.step)


def test_ground_that_steps_do_not_treat_has_none() -> None:
    """Skids and the law of unit directions."""
    for ground in ("skid", "unit"):
        assert stepper_of(draw(2, ground, 1).model()) is None


@pytest.mark.slow
def test_the_example_of_an_obstacle_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """The worm goes round the disc and does not enter it."""
    page = DOCS / "theory-planar.md"
    code = re.search(r"```python\n(.*?MoreauJean.*?)```", page.read_text(encoding="utf-8"), re.S)
    assert code
    exec(code[1], {})
    nearest = float(capsys.readouterr().out.split()[1].rstrip(";"))
    assert abs(nearest) < 2e-3
