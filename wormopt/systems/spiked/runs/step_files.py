"""Step commands of a saved or computed Result, as Steps and as files."""

from __future__ import annotations

from wormopt.quantities import Variable, unit_of
from wormopt.result import Result
from wormopt.systems.spiked.stepper.steps import Steps, c_text, csv_text


def step_variables(steps: Steps) -> list[Variable]:
    """Variables from which `steps_of_result` reads the commands back; motors count from 1.

    Needs at least one step.
    """
    return [
        Variable("step_time", unit_of("time", "SI"), ("step",), steps.time, "time of the step"),
        Variable("step_motor", "1", ("step",), steps.motor + 1, "motor of link"),
        Variable("step_direction", "1", ("step",), steps.direction, "1 lengthens the link"),
        Variable("length_start", "m", ("link",), steps.start, "length at time 0"),
    ]


def steps_of_result(result: Result) -> Steps | None:
    """Commands in a ``stepper`` result; None where the study did not come so far."""
    if "step_time" not in result:
        return None
    return Steps(
        result.scalars["period"].value,
        result.scalars["travel_per_step"].value,
        result["length_start"].values,
        result["step_time"].values,
        result["step_motor"].values.astype(int) - 1,
        result["step_direction"].values.astype(int),
    )


def as_csv(result: Result) -> str | None:
    """Text of ``steps.csv``; None without steps.

    Also None where the result failed: no motor is to run by it.
    """
    steps = _trusted(result)
    return None if steps is None else csv_text(steps)


def as_c(result: Result) -> str | None:
    """Text of ``steps.c``; None without steps.

    Also None where the result failed: no motor is to run by it.
    """
    steps = _trusted(result)
    return None if steps is None else c_text(steps, result.scalars["tick"].value)


def _trusted(result: Result) -> Steps | None:
    return steps_of_result(result) if result.status == "ok" else None
