"""Everything counts from 0: columns of files, motors, links, messages."""

from pathlib import Path

import numpy as np
import pytest

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.systems.pair.exact import magnetic_pair
from wormopt.systems.spiked.stepper.steps import c_text, csv_text

PAIR = {"law": wo.Coulomb(0.02, 0.04), "push": 0.04, "frequency": 1.4}
MOTOR = {"lead": 2e-3, "steps_per_turn": 200, "microsteps": 2}


def steps():
    return wo.stepper.step_times(wo.fast_gait(18.0, 0.1), wo.stepper.Stepper(**MOTOR))


def test_the_first_column_of_a_gait_table_is_link_0(tmp_path: Path):
    gait = wo.Gait(np.array([0.0, 1.0]), np.array([[[1.0], [3.0]]]))
    gait.to_csv(tmp_path / "gait.csv")
    head, first, *_ = (tmp_path / "gait.csv").read_text().splitlines()
    assert head == "time,length_0,length_1"
    assert [float(v) for v in first.split(",")] == [0.0, 1.0, 3.0]


def test_step_tables_name_motors_0_and_1():
    rows = [line for line in csv_text(steps()).splitlines() if not line.startswith("#")][1:]
    assert {int(row.split(",")[1]) for row in rows} == {0, 1}
    source = c_text(steps(), 1e-6)
    assert "motor_0_delay" in source
    assert "motor_1_delay" in source
    assert "motor_2" not in source


def test_variables_of_a_stepper_result_count_as_arrays_do():
    result = wo.run(wo.load_scene("prototype_steps", ["want=[]"]))
    assert set(result["step_motor"].values.tolist()) == {0, 1}
    assert result["turn_link"].values[0] in (0, 1)
    counts = np.bincount(result["step_motor"].values.astype(int))
    assert counts.tolist() == result.scalars["step_count"].value


def test_messages_name_the_head_link_0():
    fast = wo.stepper.Stepper(**MOTOR, rate_max=1.0)
    with pytest.raises(SolveError, match="motor of link 0 at"):
        wo.stepper.step_times(wo.fast_gait(1.0, 0.1), fast)
    broken = wo.Gait(np.array([0.0, 1.0]), np.array([[[1.0, 1.0], [1.0, 0.0]]]))
    with pytest.raises(ArgumentError, match="length of link 0 jumps"):
        wo.stepper.step_times(broken, wo.stepper.Stepper(**MOTOR))


def test_the_masses_of_a_pair_are_0_and_1():
    assert [contact.name for contact in magnetic_pair(**PAIR).contacts] == ["mass 0", "mass 1"]
