"""Choice of the integrator of a task: compiled steps if possible, others if necessary."""

from __future__ import annotations

from dataclasses import replace

from wormopt.progress import Report
from wormopt.simulation.held import hold
from wormopt.simulation.initial_value import InitialValueProblem, Outcome
from wormopt.simulation.options import Route

# Implicit steps in Python cost some hundred compiled ones each: a motion that needs more than this
# is not stiff but full of events, or too slow to wait for.
_STEPS_IN_PYTHON = 20_000
# After this many steps, the beginning of a motion is no short transient.
_STEPS_FOR_A_LOOK = 4_000
STIFF_STEPS = 1_000_000
"""A smooth motion is stiff if stability alone would need this many more explicit steps."""


def integrate(task: InitialValueProblem, route: Route, report: Report) -> Outcome:
    """Integrate by the requested route; "auto" is the first possible one.

    Conditions in the right-hand side are held between the instants at which they change.

    Raises ValueError if the route cannot integrate the task, CompilerError if the native route is
    requested without a compiler.
    """
    held = hold(task, switches=route != "cvodes")
    if held is None:
        return _integrate(task, route, report)
    return held.outcome(_integrate(held.task, route, report))


def _integrate(task: InitialValueProblem, route: Route, report: Report) -> Outcome:
    if task.system.model.alg.numel() or route == "cvodes":
        return _implicitly(task, report)
    if route in ("python", "radau"):
        return _in_python(task, report, stiff=route == "radau")
    outcome = _native(task, report, required=route == "native")
    open_ = outcome is not None and outcome.status == "no_contact_mode" and task.system.shares
    if outcome is None or open_:  # no compiler, or a load to split: the same steps, slower
        outcome = _in_python(task, report)
    if outcome.status != "stiff" or route != "auto":
        return outcome
    implicit = _patiently(task, report) if _needs_own_steps(task) else _implicitly(task, report)
    if implicit.status in ("done", "interrupted"):
        return implicit
    # neither succeeds, or not soon: let explicit steps find the reason
    return _native(task, report, required=False, stiff_steps=2**62) or outcome


def _patiently(task: InitialValueProblem, report: Report) -> Outcome:
    """Implicit steps in Python, at most as many as are worth their time."""
    start, end = task.span

    def at_most(steps: int) -> Outcome:
        few = min(task.tolerance.max_steps, steps)
        briefly = replace(task, tolerance=replace(task.tolerance, max_steps=few))
        return _in_python(briefly, report, stiff=True)

    outcome = at_most(_STEPS_FOR_A_LOOK)
    if outcome.status == "too_many_steps" and outcome.t - start > 1e-4 * (end - start):
        return at_most(_STEPS_IN_PYTHON)
    return outcome


def _needs_own_steps(task: InitialValueProblem) -> bool:
    """Whether the request exceeds what SUNDIALS supports."""
    return bool(task.system.model.switches) or task.dense


def _native(
    task: InitialValueProblem, report: Report, *, required: bool, stiff_steps: int = STIFF_STEPS
) -> Outcome | None:
    from wormopt.simulation.native.build import CompilerError
    from wormopt.simulation.native.kernel import compiled, integrate

    try:
        ready = compiled(task.system, task.variation)
    except CompilerError:
        if required:
            raise
        return None
    return integrate(task, ready, report, stiff_steps)


def _in_python(task: InitialValueProblem, report: Report, *, stiff: bool = False) -> Outcome:
    from wormopt.simulation.automaton import integrate

    return integrate(task, report, stiff=stiff)


def _implicitly(task: InitialValueProblem, report: Report) -> Outcome:
    from wormopt.simulation.sundials import integrate

    return integrate(task, report)
