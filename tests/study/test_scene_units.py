"""Numbers with units in scenes: against pint, and what is refused."""

import contextlib
import json
import math
import re
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pint
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import SceneError
from wormopt.quantities import UNITS, has_unit, parsed, to_number
from wormopt.study import load_scene
from wormopt.study.reference import schema

PINT = pint.UnitRegistry()
PREFIXES = ["", "n", "u", "µ", "m", "c", "d", "k", "M", "G"]
SYMBOLS = ["m", "g", "s", "A", "rad", "Hz", "N", "Pa", "J", "W", "T"]
WHOLE = ["min", "h", "deg"]
NUMBERS = st.decimals(-1000, 1000, places=4).map(str) | st.floats(1e-9, 1e9).map(repr)


@st.composite
def unit_texts(draw: st.DrawFn) -> str:
    """A product of units, and units to divide by."""
    one = st.builds("{}{}".format, st.sampled_from(PREFIXES), st.sampled_from(SYMBOLS))
    factor = st.builds(
        lambda symbol, power: symbol if power == 1 else f"{symbol}^{power}",
        one | st.sampled_from(WHOLE),
        st.sampled_from([-3, -2, -1, 1, 2, 3]),
    )
    above = draw(st.lists(factor, min_size=1, max_size=3))
    below = draw(st.lists(factor, max_size=2))
    return "/".join([draw(st.sampled_from([" ", "*", " · "])).join(above), *below])


BASE = {"m": "meter", "kg": "kilogram", "s": "second", "A": "ampere"}


@given(unit_texts())
def test_units_are_those_of_pint(unit: str):
    factor, dimension = parsed(unit)
    known = PINT.Quantity(1.0, unit.replace(" · ", "*").replace(" ", "*")).to_base_units()
    powers = {name: power for name, power in known.unit_items() if name != "radian"}
    assert {BASE[name]: power for name, power in dimension.items() if name != "rad"} == powers
    assert float(factor) == pytest.approx(known.magnitude, rel=1e-12)


@given(st.sampled_from([name for name in UNITS if UNITS[name] != "1"]), NUMBERS, st.data())
def test_numbers_with_prefixes_are_those_of_pint(quantity: str, number: str, data: st.DataObject):
    prefixes = st.sampled_from(PREFIXES)
    parts = [data.draw(prefixes) + part.removeprefix("k") for part in UNITS[quantity].split()]
    known = PINT.Quantity(float(number), by_hand("*".join(parts)))
    known = known.to(by_hand("*".join(UNITS[quantity].split()))).magnitude
    found = to_number(f"{number} {' '.join(parts)}", quantity, "SI")
    assert found == pytest.approx(known, rel=1e-12)


def by_hand(unit: str) -> str:
    """Powers as pint reads them."""
    return re.sub(r"(-?\d)", r"^\1", unit)


@pytest.mark.parametrize("quantity", [name for name in UNITS if UNITS[name] != "1"])
@settings(max_examples=examples(15))
@given(number=NUMBERS)
def test_a_quantity_takes_its_own_unit(quantity: str, number: str):
    assert to_number(f"{number} {UNITS[quantity]}", quantity, "SI") == float(number)


@given(st.decimals(0, 1000, places=4))
def test_decimals_are_exact(number: Any):
    """Not one rounding off: "60 mm" is the very number that 0.06 is, by decimal arithmetic."""
    assert to_number(f"{number} mm", "length", "SI") == float(number / 1000)
    assert to_number(f"{number} kPa", "stress", "SI") == float(number * 1000)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("0,5", 'has a decimal comma; write "0.5"'),
        ("0.7,1.3", "is a list without brackets; write [0.7,1.3]"),
        ("20,27,40", "is a list without brackets; write [20,27,40]"),
    ],
)
def test_commas_are_told_apart(text: str, told: str):
    with pytest.raises(ValueError, match=re.escape(told)):
        to_number(text, "length", "SI")


@pytest.mark.parametrize(
    ("text", "quantity", "value"),
    [
        ("60mm", "length", 0.06),
        ("60 mm/s²", "acceleration", 0.06),
        ("1.5 N·s·m⁻¹", "drag", 1.5),
        ("20/s", "rate", 20.0),
        ("20 1/s", "rate", 20.0),
        ("20 Hz", "rate", 20.0),
        ("10 °", "rad", math.radians(10)),
        ("180 deg/s", "angular_frequency", math.pi),
        ("5 %", "share", 0.05),
        ("2 min", "s", 120.0),
        ("100 Oe", "magnetic_field", 1e5 / (4 * math.pi)),
        ("3 mm**2", "area", 3e-6),
    ],
)
def test_forms_of_units(text: str, quantity: str, value: float):
    assert to_number(text, quantity, "SI") == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "quantity", "said"),
    [
        ("5 kg", "length", 'is not a length; write a length, for example "60 mm" or 0.06'),
        ("5 mx", "length", '"mx"'),
        ("5 kmin", "time", '"kmin"'),
        ("5 kg/m s", "density", "ambiguous"),
        ("5 m/", "length", "nothing after"),
        ("5 m^99", "length", "a unit that cannot be read"),
        ("20 Hz", "angular_frequency", "not an angular frequency"),
        ("5 m", "count", "bare number"),
        ("1e999 m", "length", "too large"),
        ("1" * 6000 + " m", "length", "too large"),
        ("5 %", "length", "not a length"),
        ("1e-999 m", "length", "too small"),
        ("5 1 m", "length", "two numbers"),
        ("0,25 N", "force", 'write "0.25 N"'),
    ],
)
def test_what_is_refused(text: str, quantity: str, said: str):
    assert has_unit(text)
    with pytest.raises(ValueError, match="write") as caught:
        to_number(text, quantity, "SI")
    assert said in str(caught.value)


@given(st.text())
def test_any_text_is_read_or_refused(text: str):
    if has_unit(text):
        with contextlib.suppress(ValueError):
            assert math.isfinite(to_number(text, "length", "SI"))


def test_a_scene_with_units_is_the_same_scene(tmp_path: Path):
    scene = wo.load_scene("prototype_steps")
    units = {
        "worm.mass": "300 g",
        "worm.load": "300 mN",
        "gait.rest_length": "100 mm",
        "motor.lead": "2 mm",
        "motor.rate_max": "5 Hz",
        "motor.acceleration_max": "20 s-2",
        "tick": "1 us",
        "gait.elongation": "15 %",
    }
    other = wo.load_scene(scene, units)
    assert (other.text, other.key) == (scene.text, scene.key)
    sets = [f'{key}="{value}"' for key, value in units.items()]
    assert wo.load_scene("prototype_steps", sets).key == scene.key
    per_mass = {"worm.mass": ["300 g", 0.3, "0.3 kg"]}
    assert wo.load_scene(scene, per_mass).table.worm.mass == (0.3, 0.3, 0.3)


@pytest.mark.parametrize(
    ("name", "change", "key", "said"),
    [
        ("prototype_steps", 'gait.rest_length="5 kg"', "gait.rest_length", "not a length"),
        ("prototype_steps", 'worm.mass=[1, "5 m", 1]', "worm.mass[1]", '"5 m" is not a mass'),
        ("prototype_steps", 'worm.mass="-5 g"', "worm.mass", "above 0"),
        ("prototype_steps", 'worm.links="2 m"', "worm.links", "bare number"),
        ("prototype_steps", 'worm.mass="0.3"', "worm.mass", "a finite number"),
        ("fast_gait", 'worm.load="5 N"', "worm.load", 'units = "SI"'),
        ("fast_gait", 'worm.load="0,5"', "worm.load", 'write "0.5"'),
        ("fast_gait", "worm.load=[1,2", "worm.load", "close its brackets"),
        ("design_fast_gait", 'gait.length=["7 m", 13]', "gait.length[0]", 'units = "SI"'),
    ],
)
def test_a_wrong_unit_is_refused_with_file_and_key(
    capsys: pytest.CaptureFixture[str], name: str, change: str, key: str, said: str
):
    assert main(["run", name, "--set", change]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"{name}: {key}: ")
    assert said in err


def test_times_of_the_clock_have_units_in_every_scene():
    scene = wo.load_scene("design_fast_gait", {"search.time_limit": "2 min"})
    assert scene.table.search.time_limit == 120.0


def test_the_schema_allows_units_where_there_are_some():
    raw = json.loads(wo.load_scene("prototype_steps").text)
    raw["gait"]["rest_length"], raw["worm"]["mass"] = "100 mm", ["300 g", 0.3, "0.3 kg"]
    jsonschema.validate(raw, schema("stepper"))
    for key, wrong in (("mass", "heavy"), ("mass", "0.3"), ("links", "2 m"), ("mass", -1)):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(raw | {"worm": raw["worm"] | {key: wrong}}, schema("stepper"))


def test_torques_of_joints_have_units_with_or_without_the_radian():
    for text in ("50 N mm", "0.05 N m", "0.05 N m/rad"):
        assert to_number(text, "joint_stiffness", "SI") == 0.05
    assert to_number("20 N mm s", "joint_damping", "SI") == 0.02
    assert to_number("2 N m/deg", "joint_stiffness", "SI") == pytest.approx(360 / np.pi, rel=1e-15)
    assert to_number("45 deg", "angle", "dimensionless") == np.radians(45)
    with pytest.raises(ValueError, match="torque"):
        to_number("5 N", "torque", "SI")


def test_a_unit_where_numbers_alone_stand_is_told_so():
    stroke = {"stroke": {"course": "polygon", "corners": [["50 mm", "10 deg"], [0.1, 0.2]]}}
    with pytest.raises(SceneError, match=r"0\.05, in metres"):
        load_scene("planar_three_link", stroke)


@pytest.mark.parametrize("change", ["worm.slope=100deg", "worm.mass=-1g", "gait.period=0 s"])
def test_a_number_with_a_unit_is_refused_as_it_was_written(change: str):
    with pytest.raises(SceneError) as caught:
        load_scene("fast_gait", ["units=SI", change])
    ((_, said),) = caught.value.faults
    assert said.startswith(f'"{change.split("=")[1]}" is not allowed; write ')
    assert "deg" not in said.split("write", 1)[1]
