"""Kind friction-design: gaits for worms on dry ground, from films of them, by scipy's motions."""

import re
from collections.abc import Mapping
from pathlib import Path
from shutil import which
from subprocess import run
from typing import Any

import numpy as np
import pytest
from outcomes import refusals
from places import ROOT

import wormopt as wo
from tests.oracles.by_gliding import Lengths, Played, Rubbing, play
from tests.stress.judge_friction import judge, lengths_of
from wormopt.cli import main
from wormopt.errors import SolveError
from wormopt.systems.spiked import Search

FORWARD, BACKWARD = 0.3, 0.8
LIMITS = wo.Limits(period=(0.3, 3.0), length=(0.045, 0.075), rate=0.2, acceleration=30.0)
# Friction is as wide as 1e-4 of the speeds: less than this many widths is no slip.
SLIP = 8.0
SAMPLES = 25  # of a piece


def gait_of(forward: float, backward: float, **more: Any) -> Lengths:
    """The fastest gait for two masses that the ground holds, as the oracle wants it."""
    limits = LIMITS.vary(spike_load=forward + backward)
    worm = wo.Worm(links=1, mass=(0.2, 0.3), load=forward, **more)
    gait = wo.design(worm, limits, search=Search(effort="quick")).gait
    return lengths_of(gait.breaks, gait.polynomial)


def on_ground(forward: float, backward: float, gait: Lengths, drag: float = 0.0) -> Played:
    ahead, back = (np.full(2, force) for force in (forward, backward))
    return play(Rubbing(np.array([0.2, 0.3]), drag, ahead, back, np.zeros(2)), gait)


@pytest.mark.slow
def test_friction_forward_is_a_load_and_grips_are_the_sum_of_both():
    """The fastest gait of this worm with spikes slips on dry ground as soon as that is weaker."""
    gait = gait_of(FORWARD, BACKWARD)
    held = on_ground(FORWARD, BACKWARD, gait)
    assert held.slip < SLIP
    assert held.unheld < SLIP
    # it uses all that the ground can give, ahead and back
    assert held.ground.max() == pytest.approx(BACKWARD, rel=1e-3)
    assert held.ground.min() == pytest.approx(-FORWARD, rel=1e-3)
    assert on_ground(FORWARD, 0.97 * BACKWARD, gait).slip > 10 * SLIP  # a resting mass slips back
    assert on_ground(0.97 * FORWARD, BACKWARD, gait).unheld > 10 * SLIP  # or is dragged ahead


def test_a_film_becomes_a_gait_that_the_ground_holds(tmp_path: Path):
    _check(judge(0, tmp_path))


@pytest.mark.slow
def test_films_of_drawn_worms_become_gaits_that_the_ground_holds(tmp_path: Path):
    """Twenty worms; 95 % intervals hold the true friction, and say where a film leaves it open."""
    found = [judge(seed, tmp_path) for seed in range(20)]
    for each in found:
        _check(each)
    held = [inside for each in found for inside in each["inside"].values()]
    assert sum(held) >= 33  # of 40; fewer have a probability of 1e-4
    assert 0 < sum(each["open"] for each in found) < 5


def _check(found: Mapping[str, Any]) -> None:
    """Limits hold in scipy's motion with the true numbers, and little speed is lost."""
    assert found["status"] == "ok"
    excess = found["excess"]
    assert max(excess[name] for name in ("length", "rate", "acceleration")) < 1e-9
    assert excess["actuator_force"] < 1e-3  # of smooth friction
    assert excess["slip"] < SLIP
    assert excess["unheld"] < SLIP
    # a film in which no mass ever slips back bounds the friction backward only from below
    least = 0.9 if found["open"] else 0.97
    assert least < found["speed"] / found["best"] < 1 + 1e-3
    assert found["told"] == pytest.approx(found["speed"], rel=2e-3)


@pytest.mark.slow
def test_the_packaged_scene_keeps_its_limits_on_the_plant():
    result = wo.run("friction_gait")
    assert result.status == "ok"
    number = {name: scalar.value for name, scalar in result.scalars.items()}
    true = {"forward": 0.25, "backward": 1.0, "stiffness": 45.0, "damping": 0.5}
    for name, value in true.items():
        assert abs(number[name] - value) < 4 * number[f"{name}_error"], name
    assert 0.99 < number["plant_share"] < 1.0
    assert number["plant_distance"] < number["reach"]
    assert max(number["held_max"]) < 1.0
    assert set(result.trust["assumptions"]) >= {"lengths", "rest", "stiction", "split", "springs"}
    # the actuators' forces by (8) in scipy's motion of the estimates, and rest lengths for them
    worm = Rubbing(
        np.array([0.2, 0.15, 0.2]), 0.0, np.array(number["forward_found"]),
        np.array(number["backward_found"]), np.zeros(3),
    )  # fmt: skip
    gait = lengths_of(result["gait_breaks"].values, result["gait_polynomial"].values)
    seen = play(worm, gait, width=1e-5, samples=SAMPLES)
    force = number["stiffness"] * (seen.length - 0.06) + number["damping"] * seen.rate
    # between breaks, at which smooth friction passes from one resting mass to the next
    inner = np.arange(len(seen.time)) % SAMPLES % (SAMPLES - 1) > 0
    times, told = result["time"].values, result["input"].values
    for row, expected in zip(told, (force - seen.link_force)[:, inner], strict=True):
        np.testing.assert_allclose(np.interp(seen.time[inner], times, row), expected, atol=5e-3)
    commanded = 0.06 + result["input"].values / number["stiffness"]
    np.testing.assert_allclose(result["commanded_length"].values, commanded, atol=1e-12)


@pytest.mark.slow
def test_ground_that_is_weaker_than_in_the_film_fails_the_trial():
    result = wo.run("friction_gait", {"plant.worm.friction.backward": 0.9})
    assert result.status == "failed"
    assert "on the plant gait.spike_load is exceeded" in result.reason


@pytest.mark.slow
def test_what_the_film_does_not_tell_is_said():
    """Without a known mass or force only ratios are known."""
    unknown = [
        {"name": "forward", "targets": "friction_forward"},
        {"name": "backward", "targets": "friction_backward"},
        {"name": "stiffness", "targets": "stiffness"},
        {"name": "damping", "targets": "damping"},
        {"name": "mass", "targets": "mass"},
    ]
    with pytest.raises(SolveError, match="stiffness, damping cannot be identified"):
        wo.run("friction_gait", {"fit.unknown": unknown})


@pytest.mark.slow
def test_the_page_leads_from_a_film_to_c_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """What the page prints, run as it stands; its figures are those that come out."""
    page = (ROOT / "docs/howto/fit-friction-from-a-video.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```(\w+)\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    film, *_ = [text for kind, text in blocks if kind == "python"]
    exec(compile(film, "film", "exec"), {})
    for text in (text for kind, text in blocks if kind == "toml"):
        Path(text.split()[1]).write_text(text)
    assert main(["run", "friction.toml", "--no-plots"]) == 0
    assert main(["run", "gait.toml", "--no-plots"]) == 0
    fitted, designed = (wo.Result.load(f"results/{name}") for name in ("friction", "gait"))
    for name, estimate, error in re.findall(
        r"\| (\w+), N.*? \| [\d.]+ \| ([\d.]+) \| ([\d.]+) \|", page
    ):
        assert fitted[name].value == pytest.approx(float(estimate), abs=float(error) / 10)
    assert designed["speed"].value == pytest.approx(0.0667, abs=5e-5)
    assert max(designed["held_max"].value) == pytest.approx(0.7943, abs=5e-5)
    assert designed["ticks"].value == 45
    assert main(["export", "results/gait", "--c", "--mjcf", "-o", "out"]) == 0
    (program,) = [text for kind, text in blocks if kind == "c"]
    Path("main.c").write_text(program)
    if (cc := which("cc")) is None:
        pytest.skip("no C compiler")
    run([cc, "-std=c99", "main.c", "out/gait.c", "-lm", "-o", "main"], check=True)
    told = run(["./main"], check=True, capture_output=True, text=True).stdout.splitlines()
    gait = wo.load_gait("results/gait")
    lengths = [float(line.split()[2]) for line in told]
    np.testing.assert_allclose(lengths, gait(np.arange(45) * 0.01)[0], atol=1e-4)


test_scenes_that_do_not_fit_together_are_refused = refusals(
    "friction_gait",
    """
    fit.kind="simulate" | fit | kind
    fit.model.worm.friction={kind="spike"} | fit.model | friction is spike
    fit.model.worm.friction.stick_backward=0.9 | fit.model | stiction
    fit.model.worm.links=3 | fit.model.worm.mass | 3 entries for 4 masses
    gait.spike_load=1.0 | gait.spike_load | the fitted friction holds the masses
    gait.sharing="least_actuation" | gait.sharing | nonlinear
    gait.rate=[1, 1, 1] | gait.rate | 3 entries for 2 links
    objective={minimise="energy_per_distance", speed=0.01} | objective.minimise | parameters
    fit.recording.0.columns={head="positon[0]"} | fit.recording[0].columns.head | no signal positon
    fit={scene="film.toml"} | fit.scene | "film.toml": there is no such file
    plant={"worm.fricton.forward"=1.0} | plant.worm.fricton | did you mean friction
    """,
)
