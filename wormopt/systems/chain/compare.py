"""Controllers of one plant, compared on the nominal plant and on drawn plants."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import ArgumentError, Fault, SolveError
from wormopt.progress import Report
from wormopt.result import NOT_RECHECKED, Check, Result, Unchecked
from wormopt.study import (
    arrays,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    scalar,
    scalars,
    stage,
    warnings,
)
from wormopt.study.numerics import TimeSpan, ToleranceTable
from wormopt.systems.chain.controllers import Draws
from wormopt.systems.chain.hardware import Hardware, faults_of_hardware
from wormopt.systems.chain.tables import Tube
from wormopt.systems.chain.tracking import Following
from wormopt.systems.shared.declared import JUDGED, LOOP_SIGNALS, TIME, Scalars, Variables, over

with on_use():
    import numpy as np

    from wormopt.control.drive import drive
    from wormopt.control.interconnect import own_states
    from wormopt.control.loop import (
        Reference,
        TrackingError,
        as_tracked,
        cut,
        followed_by,
        with_reference,
    )
    from wormopt.model.gait import Gait
    from wormopt.model.given import check_kind
    from wormopt.model.model import Model
    from wormopt.systems.chain.controllers import Controller, Judged, Trial
    from wormopt.systems.chain.copies import Draw, drawn_plants
    from wormopt.systems.chain.drawn import (
        Drawn,
        drawn_table,
        interval_table,
        less,
        nominal_table,
    )
    from wormopt.systems.shared.proof import accepted_error
    from wormopt.systems.shared.signals import fitted

COMPARED = ("error_norm", "length", "input", "position")
"""Signals that are kept of every controller; the last one of chains only."""
RANKED = ("time_outside_tube", "error_peak", "error_integral", "input_integral", "distance")
"""Quantities that are reported as medians over the plants with intervals, and compared between
controllers.
"""

_RIVALS = ("reference", "rival")
_COUNTS: Scalars = {
    "tube_radius": ("length", "*λ*"),
    "draws": ("count", "number of drawn plants"),
    "draws_failed": ("count", "plants whose simulation failed"),
    "draws_outside": ("count", "plants that leave the tube after the time of capture"),
}
_SIGNALS: Variables = {
    **TIME,
    **over({name: LOOP_SIGNALS[name] for name in COMPARED}, *_RIVALS),
    "aim": ("length", ("reference", "link", "time"), "reference of the link length"),
}
_DRAWN: Variables = {
    f"drawn_{name}": (quantity, (*_RIVALS, "member"), f"{name} of the plant")
    for name, (quantity, _) in JUDGED.items()
}
_INTERVALS: Variables = {
    "outside_share": (
        "share",
        (*_RIVALS, "bound"),
        "exact 95 % interval of the share of plants that leave the tube",
    ),
    **{
        f"median_{name}": (
            JUDGED[name][0],
            (*_RIVALS, "bound"),
            f"interval of at least 95 % for the median of {name} over the plants",
        )
        for name in RANKED
    },
    **{
        f"less_{name}": (
            "count",
            (*_RIVALS, "other"),
            f"plants on which {name} is lower than with the other controller",
        )
        for name in RANKED
    },
}


class Rivals(Following):
    """Base of comparisons: every controller on the nominal plant and on drawn plants."""

    table_file: ClassVar = True

    tube: Tube = entry("tube that all controllers are judged by, from the time of capture on")
    draws: Draws = entry("plants with drawn parameters")
    hardware: Hardware = entry(
        "sensors, actuators and clock of all controllers; default: exact measurements at all "
        "times, and inputs without other limits than the plant's",
        default=Hardware,
    )
    tolerance: ToleranceTable = entry(
        "tolerance of the simulation of the nominal plant", default=ToleranceTable
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.tube.faults_in(self.time.end)

    @property
    def references(self) -> Sequence[str]:
        """Names of the references."""
        raise NotImplementedError

    def controllers(self, index: int) -> Iterator[Controller]:
        """All controllers for a reference."""
        raise NotImplementedError

    def drawn(self) -> Sequence[Draw]:
        """Parameters of the drawn plants."""
        raise NotImplementedError

    def by_hardware(self, plant: Model, loop: Model) -> Model:
        """A loop whose controller measures and acts by the scene's hardware."""
        return loop if self.hardware.ideal else self.hardware.around(plant, loop, self.time.end)

    @cached_property
    def trial(self) -> Trial:
        """Plants and conditions for all controllers."""
        return Trial(self.tube, self.time, self.tolerance, self.hardware, self.drawn())

    # -- motions -----------------------------------------------------------------------------------

    @stage
    def runs(self) -> Sequence[Sequence[Judged]]:
        """Every controller on all plants, by reference."""
        found = [
            [self._judged(each, again=not k) for each in self.controllers(k)]
            for k in range(len(self.references))
        ]
        if all(each.motion is None for row in found for each in row):
            raise SolveError(
                "no controller keeps the nominal plant near the tube; reduce the noise, delay or "
                "period of the hardware"
            )
        return found

    def _judged(self, controller: Controller, *, again: bool) -> Judged:
        self.report(f"simulating {controller.name}")
        return self.trial.judge(controller, again=again)

    # -- results -----------------------------------------------------------------------------------

    @cached_property
    def rivals(self) -> Sequence[str]:
        """Names of all controllers; a plan that was not found may be missing for a reference."""
        longest_first = sorted(self.runs, key=len)[::-1]
        return [*dict.fromkeys(each.name for row in longest_first for each in row)]

    @cached_property
    def rows(self) -> Sequence[Sequence[Judged | None]]:
        """Runs by reference, with an entry for every name."""
        rows = [{each.name: each for each in row} for row in self.runs]
        return [[row.get(name) for name in self.rivals] for row in rows]

    @scalars(_COUNTS, headline=("tube_radius", "draws", "draws_failed", "draws_outside"))
    def totals(self) -> dict[str, Any]:
        return {
            "tube_radius": self.tube.radius,
            "draws": self.draws.members,
            "draws_failed": [[each and each.drawn.failed for each in row] for row in self.rows],
            "draws_outside": [[each and each.drawn.outside for each in row] for row in self.rows],
        }

    @scalars(JUDGED, headline=("distance",))
    def numbers(self) -> dict[str, Any]:
        return {
            name: [[each and each.numbers[name] for each in row] for row in self.rows]
            for name in JUDGED
        }

    @scalar("share", "error of the second route for the first reference, without trackers")
    def recheck_error(self) -> float | None:
        found = [each.second.error for each in self.runs[0] if each.second]
        return max((error for error in found if error is not None), default=None)

    @arrays(_SIGNALS)
    def signals(self) -> dict[str, Any]:
        """Signals of the nominal plant; NaN where it is lost or a plan was not found."""
        names = COMPARED if self.own is None else COMPARED[:-1]
        sampled = [[each and each.signals(names) for each in row] for row in self.rows]
        one = next(signals for row in sampled for signals in row if signals)
        lost = {name: np.full_like(values, np.nan) for name, values in one.items()}
        rows = {
            name: np.array([[(each or lost)[name] for each in row] for row in sampled])
            for name in names
        }
        aims = [
            next((e.motion["reference"] for e in row if e.motion), lost["length"])
            for row in self.runs
        ]
        times = np.linspace(0.0, self.time.end, self.time.samples)
        return {"time": times, **fitted(rows, _SIGNALS), "aim": np.array(aims)}

    @cached_property
    def drawn_rows(self) -> Sequence[Sequence[Drawn]]:
        """Quantities of the drawn plants by reference and name; NaN without a plan."""
        none = Drawn.of([None] * self.draws.members)
        return [[each.drawn if each else none for each in row] for row in self.rows]

    @arrays(_DRAWN)
    def on_drawn(self) -> dict[str, Any]:
        return {
            f"drawn_{name}": np.array([[d.values[name] for d in row] for row in self.drawn_rows])
            for name in JUDGED
        }

    @arrays(_INTERVALS)
    def intervals(self) -> dict[str, Any]:
        rows = self.drawn_rows
        found = {"outside_share": np.array([[d.outside_share for d in row] for row in rows])}
        for name in RANKED:
            found[f"median_{name}"] = np.array([[d.median(name) for d in row] for row in rows])
            ranks = [less(np.array([d.values[name] for d in row])) for row in rows]
            found[f"less_{name}"] = np.array(ranks)
        return found

    @attributes
    def names(self) -> dict[str, Any]:
        return {
            "references": [*self.references],
            "rivals": self.rivals,
            "table": "\n".join([*self.tables(), ""]),
        }

    def tables(self) -> Iterator[str]:
        """Lines of Markdown with all figures."""
        end, capture, draws = self.time.end, self.tube.capture, self.draws
        yield (
            f"λ = {self.tube.radius:g}, time 0 to {end:g}. Time outside the tube and the "
            f"largest |e| count from t = {capture:g} on. Work spent is the positive power of each "
            "actuator over time, without recovery; net work includes the power that flows back. "
            "Cost of transport is work spent over total mass and distance. One simulator with "
            "exact contact computes all motions."
        )
        if words := self.hardware.words:
            yield ""
            yield words
        for name, row in zip(self.references, self.runs, strict=True):
            plants = {one.name: one.drawn for one in row}
            nominal = {one.name: one.numbers for one in row}
            drawn = f"{draws.members} plants, ±{draws.spread:.0%}"
            yield from ("", f"## {name}: the nominal plant", "", *nominal_table(nominal))
            yield from ("", f"## {name}: {drawn}", "", *drawn_table(plants))
            intervals = interval_table(plants, RANKED)
            yield from ("", f"## {name}: intervals over the plants", "", *intervals)

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def checks_of_motions(self) -> Iterator[Check]:
        for reference, row in zip(self.references, self.runs, strict=True):
            for each in row:
                yield from each.checks(self.tolerance.options, f"{reference}, {each.name}")

    @facts
    def agreement(self) -> dict[str, Any]:
        first = self.runs[0]
        residuals = [abs(each.energy.residual) for row in self.runs for each in row if each.energy]
        return {
            "recheck": {
                "route": next((each.second.route for each in first if each.second), None),
                "error": {each.name: each.second and each.second.error for each in first},
                "accepted": accepted_error(self.tolerance.options),
            },
            "energy_balance": max(residuals, default=None),
        }

    @warnings
    def lost(self) -> Iterator[str]:
        for reference, row in zip(self.references, self.runs, strict=True):
            for each in row:
                yield from each.warnings(f"{reference}, {each.name}")
        yield from self._not_rechecked()

    def _not_rechecked(self) -> Iterator[str]:
        """Warn of motions of the first reference without a second route."""
        moved = [each for each in self.runs[0] if each.motion]
        alone = [each.name for each in moved if not each.second]
        if not self.tolerance.recheck:
            yield NOT_RECHECKED
        elif len(alone) == len(moved):
            yield Unchecked(
                "no second route rechecks a motion here: those of trackers and of delayed "
                'measurements take too long; scenes of kind "track" recheck trackers'
            )
        elif alone:
            yield f"no second route rechecks {', '.join(alone)}"


# -- from Python -----------------------------------------------------------------------------------


class _Asked(Rivals):
    """A comparison of loops that Python functions close, with these in its `__dict__`."""

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.tube.faults_in(self.time.end)
        yield from faults_of_hardware(self.hardware, self.time.end)

    @property
    def references(self) -> Sequence[str]:
        """The only reference."""
        return ["reference"]

    def drawn(self) -> Sequence[Draw]:
        own, spread = vars(self)["own"], vars(self)["_spread"]
        return drawn_plants(own, spread, self.draws.seed, self.draws.members)

    def controllers(self, index: int) -> Iterator[Controller]:
        """Close the loop of every rival."""
        plant, reference = vars(self)["own"], vars(self)["_reference"]
        for name, rival in vars(self)["_rivals"].items():
            try:
                loop = _closed(rival, plant, reference, self.tube.radius)
                yield Controller(name, self.by_hardware(plant, loop))
            except ArgumentError as error:
                raise ArgumentError(f"rival {name!r}: {error}") from None


def _closed(
    rival: Callable[[Model, Reference], Model] | Gait,
    plant: Model,
    reference: Reference,
    radius: float,
) -> Model:
    """Closed loop of a rival, with the outputs of its error; ArgumentError for others."""
    if isinstance(rival, Gait):
        return drive(with_reference(plant, reference), rival)
    loop = rival(plant, reference)
    check_kind("the returned loop", loop, Model)
    own_states(loop, plant)
    if loop.u:
        left = ", ".join(signal.name for signal in loop.u)
        raise ArgumentError(
            f"{loop.name} has inputs left, {left}; put the controller in their place"
        )
    names = {output.name for output in loop.outputs}
    if "input" not in names:
        raise ArgumentError(f"{loop.name} has no output 'input' for the action of the controller")
    radii = (p.value for p in loop.p if p.name == "tube_radius" and p.value is not None)
    own = next(radii, radius)
    if not np.allclose(own, radius, rtol=1e-9, atol=0.0):
        raise ArgumentError(
            f"tube_radius={own} differs from {radius:g}, the radius of the comparison; "
            "write the same value"
        )
    courses = {schedule.name for schedule in loop.schedules}
    error = TrackingError.of(plant, reference)
    loop = cut(plant, loop)
    return replace(
        loop,
        outputs=[*loop.outputs, *(o for o in error.shown(reference) if o.name not in names)],
        schedules=[
            *loop.schedules,
            *(schedule for schedule in reference.schedules if schedule.name not in courses),
        ],
    )


def compare(
    plant: Model,
    reference: Reference,
    rivals: Mapping[str, Callable[[Model, Reference], Model] | Gait],
    *,
    end: float,
    tube_radius: float,
    capture: float = 0.0,
    hardware: Hardware | None = None,
    spread: float | Mapping[str, float] = 0.2,
    members: int = 50,
    seed: int = 0,
    output: str = "length",
    input: str = "input",  # noqa: A002
    samples: int = 501,
    title: str = "",
    report: Report | None = None,
) -> Result:
    """Compare controllers of a plant, on itself and on plants with drawn parameters.

    Every rival has the same sensors, actuators and clock, and is judged by the same tube around the
    reference. Controllers are made once, for the parameters of `plant`, and do not know those of
    the drawn plants. The comparison is that of scenes of kind ``compare-tracking``.

    Parameters
    ----------
    plant : Model
        A model with start values of its states and values of its parameters.
    reference : Reference
        Reference of the output, an expression of ``plant.t``.
    rivals : mapping of str to callable or Gait
        By name: a function of the plant and the reference that returns the closed loop, such as
        ``partial(wo.lqr, error_weight=1e4)``, or inputs over time. The function gets a plant whose
        tracked output is called ``length`` and its input ``input``, as those of a chain.
    end : float
        Last time of the motions, which begin at 0.
    tube_radius : float
        Radius of the tube around the reference.
    capture : float, optional
        Time from which the error must stay in the tube.
    hardware : Hardware, optional
        Limits, sampling, noise, delay and rounding; by default controllers measure exactly and act
        at all times, within the bounds of the plant's input.
    spread : float or mapping of str to float, optional
        Parameters of the drawn plants are uniform within ± this share of their values: that of all
        parameters, or by name.
    members : int, optional
        Number of drawn plants, at least 2.
    seed : int, optional
        Seed of the drawn plants.
    output, input : str, optional
        Names of the plant's output, or state, that follows, and of the input.
    samples : int, optional
        Times at which signals of the plant itself are kept.
    title : str, optional
        Title of pictures; by default the plant's name is in it.
    report : callable, optional
        Called with a text and the fraction done.

    Returns
    -------
    Result
        ``result.attributes["table"]`` is the comparison as Markdown, ``result.plot()`` and
        ``result.plot("draws")`` are pictures. ``outside_share`` is the exact 95 % interval of the
        share of plants that leave the tube, ``median_error_peak`` and others are intervals of
        medians over the plants, all by reference, rival and bound.

    Raises
    ------
    ArgumentError
        If a name, size or relative degree does not fit, or a loop cannot be closed; the message
        names the rival.
    SolveError
        If a motion of the plant itself cannot be simulated.

    Examples
    --------
    A wheel on a torsion spring, turned by a motor of limited torque that is set 100 times a second:

    >>> from functools import partial
    >>> import casadi as ca
    >>> import wormopt as wo
    >>> phi, spin, torque, inertia = (ca.SX.sym(n) for n in ("phi", "spin", "torque", "inertia"))
    >>> wheel = wo.Model(
    ...     "wheel",
    ...     x=[wo.Signal("angle", phi, "angle", value=0), wo.Signal("spin", spin, value=0)],
    ...     ode=ca.vertcat(spin, (torque - 2 * phi - 0.1 * spin) / inertia),
    ...     u=[wo.Signal("torque", torque)],
    ...     p=[wo.Signal("inertia", inertia, value=0.5)],
    ... )
    >>> rivals = {
    ...     "LQR": partial(wo.lqr, error_weight=400.0),
    ...     "tracker": partial(wo.lambda_tracker, tube_radius=0.1),
    ... }
    >>> aim = wo.gait_reference(wo.Gait([0.0, 1.0], [[[0.4]]]), wheel.t)
    >>> found = compare(wheel, aim, rivals, end=3.0, tube_radius=0.1, capture=2.0, members=6,
    ...     hardware=wo.Hardware(period=0.01, input_limit=6.0), output="angle", input="torque")
    >>> found.attributes["rivals"], found["draws_outside"].value
    (['LQR', 'tracker'], [[0, 6]])
    """
    followed_by(plant, reference, output)
    if not isinstance(rivals, Mapping) or not rivals:
        raise ArgumentError("rivals must be a mapping of at least one name to a function or a Gait")
    if wrong := [name for name in rivals if not isinstance(name, str) or not name]:
        raise ArgumentError(f"names of rivals must be non-empty texts, not {wrong[0]!r}")
    shares = spread if isinstance(spread, Mapping) else {s.name: spread for s in plant.p}
    for name, share in shares.items():
        if not isinstance(share, int | float) or not 0 <= share < 1:
            what = "a number from 0 on and below 1, or a mapping of names to such numbers"
            raise ArgumentError(f"spread of {name} is {share!r}; write {what}")
    study = _Asked(
        kind="compare-tracking",
        title=title or f"Controllers of {plant.name}",
        tube=Tube(radius=tube_radius, capture=capture),
        time=TimeSpan(end=end, samples=samples),
        draws=Draws(members=members, spread=max(shares.values(), default=0.0), seed=seed),
        hardware=hardware or Hardware(),
    )
    followed = study.hardware.limited(as_tracked(plant, output, input))
    vars(study).update(own=followed, _reference=reference, _rivals=dict(rivals), _spread=shares)
    return replace(study.result(report), scene="comparison", scene_text="")
