"""Sizes that are hardly meant so are warned of, in SI scenes alone; nothing is refused."""

import re
from pathlib import Path

import pytest

import wormopt as wo
from wormopt.cli import main
from wormopt.quantities import UNITS
from wormopt.study import packaged_scenes
from wormopt.study.plausible import USUAL


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"gait.rest_length": 60}, 'gait.rest_length = 60 m is unusual .*"60 mm"'),
        ({"worm.mass": [0.3, 1e6, 0.3]}, r"worm.mass\[1\] = 1e\+06 kg"),
        ({"gait.period": 1e-6}, "gait.period = 1e-06 s"),
        ({"worm.load": 3e5}, 'worm.load = 300000 N .*"300000 mN"'),
        ({"motor.lead": 2e4}, "motor.lead = 20000 m"),
    ],
)
def test_a_surprise_is_named(change: dict[str, object], said: str):
    scene = wo.load_scene("prototype_steps", change)
    (warning,) = scene.warnings
    assert re.search(said, warning)


def test_zero_is_no_surprise_nor_is_what_was_left_out():
    assert wo.load_scene("prototype_steps", {"worm.load": 0, "bristles.backslip": 0}).warnings == ()


def test_scenes_without_units_are_not_judged():
    assert wo.load_scene("fast_gait", {"gait.rest_length": 300}).warnings == ()


def test_check_and_the_trust_report_warn(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    path = tmp_path / "big.toml"
    text = packaged_scenes()["fast_gait"].read_text(encoding="utf-8")
    path.write_text(text.replace("schema = 1", 'schema = 1\nunits = "SI"'), encoding="utf-8")
    changes = {"gait.rest_length": 300, "gait.period": 10, "want": []}
    scene = wo.load_scene(path, changes)
    (warning,) = scene.warnings
    assert warning in wo.run(scene).trust["warnings"]
    assert main(["check", str(path)]) == 0
    assert capsys.readouterr().err == ""
    path.write_text(path.read_text().replace("rest_length = 2.0", "rest_length = 300"))
    assert main(["check", str(path)]) == 0
    out, err = capsys.readouterr()
    assert out == f"{path}: ok (gait)\n"
    assert err == f"{path}: warning: {warning}\n"


def test_every_range_is_of_a_quantity_with_a_unit():
    assert all(UNITS[name] != "1" and least < most for name, (least, most) in USUAL.items())
