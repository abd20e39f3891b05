"""Kind "simulate": a chain with given inputs, or a model of the user's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from msgspec import field

from wormopt.errors import Fault, SceneError
from wormopt.quantities import Scalar, Variable
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    number,
    on_use,
    positive,
    scalar,
    scalars,
    stage,
    warnings,
)
from wormopt.study.given import wrong_count
from wormopt.study.numerics import (
    Contacts,
    ExactContact,
    Horizon,
    Start,
    Tolerances,
    ToleranceTable,
)
from wormopt.study.types import FinitePerLink, NonNegativePerLink, per
from wormopt.systems.chain.own_model import OwnModel, own_signals, own_variables
from wormopt.systems.chain.tables import ChainTable
from wormopt.systems.shared.declared import CHAIN, CHAIN_SIGNALS, EVENTS, TIME, over
from wormopt.systems.spiked import Shape

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.control.loop import TrackingError, close, gait_reference
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model, Output
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.chain.loops import build_chain, draw_links, laws_of
    from wormopt.systems.chain.measured import (
        Balance,
        balance,
        chain_checks,
        chain_facts,
        chain_numbers,
        measure_power,
    )
    from wormopt.systems.shared.proof import (
        CrossCheck,
        cross_check,
        motion_facts,
        warnings_of_contact,
        warnings_of_motion,
    )
    from wormopt.systems.shared.signals import (
        chain_expressions,
        event_arrays,
        fitted,
        sample,
        simulate_whole,
    )
    from wormopt.systems.spiked import gait_of_shape

# Signals of a chain in the picture, in this order.
_SHOWN = ("length", "velocity", "contact_force", "input")
_NUMBERS = {name: declared for name, declared in CHAIN.items() if name != "recheck_error"}
_SIGNALS = (
    TIME
    | over(CHAIN_SIGNALS)
    | {"command": ("length", ("link", "time"), "commanded rest length")}
    | EVENTS
)


class ConstantForce(Given, tag_field="law", tag="constant"):
    """Constant inputs *u*<sub>j</sub> = `force`."""

    force: FinitePerLink = entry(
        "actuator forces; a positive force pushes the masses of the link apart", quantity="force"
    )

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `folder` is the scene's."""
        yield from wrong_count("actuation.force", self.force, links, "links")


class HarmonicChange(Given, tag_field="law", tag="harmonic"):
    """Sinusoidal commanded change of the rest lengths (eq. 11 of Zimmermann et al. 2007).

    *u*<sub>j</sub> = *c*<sub>j</sub> `amplitude` sin(2π(*t*/`period` − (*j* + 1) `lag`)).
    """

    amplitude: NonNegativePerLink = entry("amplitude", quantity="length")
    period: float = positive("time", "period")
    lag: float = number(
        "share",
        "phase lag of each link behind the link ahead of it, as a fraction of a period; link "
        "0 also has this lag",
        default=0.0,
    )

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `folder` is the scene's."""
        yield from wrong_count("actuation.amplitude", self.amplitude, links, "links")


class CommandedGait(Given, tag_field="law", tag="gait"):
    """Rest lengths that are commanded to follow a gait (eq. 11 of Zimmermann et al. 2007).

    *u*<sub>j</sub> = *c*<sub>j</sub>(gait − `rest_length`).
    """

    gait: Shape = entry("the gait; `shape` selects the other keys")
    shift: float = number(
        "time", "time shift: the command at time *t* is the gait at *t* + `shift`", default=0.0
    )

    def faults(self, links: int, folder: Path) -> Iterator[Fault]:
        """Yield conflicts with a worm of this number of links; `folder` is the scene's."""
        yield from self.gait.faults(links, folder, "actuation.gait")


Actuation = ConstantForce | HarmonicChange | CommandedGait


class Simulate(Study, kind="simulate"):
    """Simulate a chain with given inputs, or a model of your own.

    A scene has `[worm]`, with optional `[start]` and `[actuation]`, or `[model]`, a function in a
    Python file: `problems/own_model.toml` with `problems/my_worm.py` is an example, instructions
    are in [simulation.md](../simulation.md#a-model-of-your-own). The result contains every named
    state and output of that Model: `<name>` over time, or `<name>_entry` over entry and time, and
    the scalar `<name>_end`. Names that the result itself needs are refused.

    At rest, `contact_force` is the force that holds the mass. `event_kind` counts from 0: reversal,
    stick, release, impact, switch. Rests are known for exact contact only. Attributes: `contacts`,
    their names, and `signals`, shown in the picture. Trust report:
    [simulations](../scenes.md#the-trust-report-of-a-simulation).
    """

    pictures: ClassVar = {
        "motion": "paths of a chain, with time upward",
        "signals": "signals over time",
        "animation": ("the moving masses of a chain, as a GIF", "wormopt.pictures.worms:animation"),
    }

    worm: ChainTable | None = entry("the chain", default=None)
    start: Start | None = entry("initial state of the chain; default: at rest length", default=None)
    actuation: Actuation | None = entry(
        "inputs *u*<sub>j</sub> of the chain; default: 0", default=None
    )
    model: OwnModel | None = entry("a model of your own; default: none", default=None)
    contact: Contacts = field(default_factory=ExactContact)
    time: Horizon
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.worm is not None and self.model is not None:
            yield "model", "both [worm] and model are given; leave one out"
        elif self.worm is not None:
            yield from self._faults_of_chain(self.worm)
        elif self.model is not None:
            yield from self._faults_of_model(self.model)
        else:
            yield "worm", 'missing; write [worm], or [model] file = "my_worm.py:build"'

    def _faults_of_chain(self, worm: ChainTable) -> Iterator[Fault]:
        yield from worm.faults(self.time.end, self.units)
        if self.start is not None:
            yield from self.start.faults(worm.links)
        if self.actuation is not None:
            yield from self.actuation.faults(worm.links, self.folder)

    def _faults_of_model(self, model: OwnModel) -> Iterator[Fault]:
        for key in ("start", "actuation"):
            if getattr(self, key) is not None:
                yield (
                    key,
                    f"applies to [worm] only, since a model defines its own {key}; leave it out",
                )
        for word in ("motion", "animation"):
            if word in self.want:
                yield "want", f'"{word}" needs a chain; write "signals" for a model'
        yield from model.faults_in(self.folder)

    # -- models ------------------------------------------------------------------------------------

    @cached_property
    def plain(self) -> Model:
        """The model to simulate; SceneError for a file that gives none."""
        if self.worm:
            return self._driven(self.worm)
        assert self.model is not None
        return self.model.load(self.name, self.folder)

    def models(self) -> dict[str, Model]:
        return {"": self.plain}

    def _driven(self, worm: ChainTable) -> Model:
        start, actuation = self.start or Start(), self.actuation
        rest = np.array(per(worm.rest_length, worm.links))
        gait, shift = self.command(rest)
        period = gait.period if gait else self.time.end
        links = draw_links(worm, self.time.end)
        model = build_chain(worm, start, links, float(rest.mean()) or 1.0, period)
        if isinstance(actuation, ConstantForce):
            held = per(actuation.force, worm.links)
            return replace(model, u=[replace(signal, value=held) for signal in model.u])
        if gait is None:
            return model
        command = gait_reference(gait, model.t, shift=shift % gait.period)
        # Eq. 11 of Zimmermann et al. 2007: c_j times the change of rest length, with the link's own
        # c_j.
        stiffness = ca.diag(ca.jacobian(model["spring_force"], model["position"])[:, : worm.links])
        force = stiffness * (command.value - rest)
        error = TrackingError.of(model, command)
        closed = close(model, command, error, force, name="commanded rest lengths")
        kept = [o for o in closed.outputs if o.name not in ("reference", "error", "error_norm")]
        return replace(closed, outputs=[*kept, Output("command", command.value, "length")])

    def command(self, rest: np.ndarray) -> tuple[Gait | None, float]:
        """Commanded rest lengths, and their time shift."""
        actuation = self.actuation
        if isinstance(actuation, CommandedGait):
            return gait_of_shape(actuation.gait, self.scene, "actuation.gait"), actuation.shift
        if not isinstance(actuation, HarmonicChange):
            return None, 0.0
        links = len(rest)
        amplitude = np.array(per(actuation.amplitude, links))
        behind = 2 * np.pi * actuation.lag * np.arange(1, links + 1)
        gait = Gait(
            np.array([0.0, actuation.period]),
            rest[None, :, None],
            np.array([2 * np.pi / actuation.period]),
            -(amplitude * np.sin(behind))[None, :],
            (amplitude * np.cos(behind))[None, :],
        )
        return gait, 0.0

    # -- motions -----------------------------------------------------------------------------------

    @stage
    def motion(self) -> Trajectory:
        model = measure_power(self.plain) if self.worm else self.plain
        treatment, span = self.contact.options, self.time
        try:
            return simulate_whole(
                model, span.end, span.samples, treatment, self.tolerance.options, self.report
            )
        except (ValueError, RuntimeError, NotImplementedError) as error:
            if self.worm:
                raise
            raise SceneError(self.name, [("model", f"cannot be simulated: {error}")]) from error

    @stage
    def recheck(self) -> CrossCheck | None:
        again = self.tolerance.recheck
        return cross_check(
            self.plain, self.motion, self.tolerance.options, recheck=again, report=self.report
        )

    @cached_property
    def energies(self) -> Balance | None:
        """Energy balance of a chain."""
        return balance(self.motion) if self.worm else None

    # -- results -----------------------------------------------------------------------------------

    @scalars(
        _NUMBERS,
        headline=("distance", "mean_speed", "input_rms", "input_peak", "x_end", "v_end"),
    )
    def numbers(self) -> Mapping[str, Any]:
        if self.worm:
            return chain_numbers(self.motion)
        ends = {f"{n}_end": Scalar(v.values[..., -1], v.unit) for n, v in self._own.items()}
        return {**ends, "n_events": len(self.motion.events), "n_steps": self.motion.n_steps}

    @scalar(*CHAIN["recheck_error"])
    def recheck_error(self) -> float | None:
        return self.recheck and self.recheck.error

    @arrays(_SIGNALS)
    def signals(self) -> Mapping[str, Any]:
        motion, events = self.motion, event_arrays([self.motion], several=False)
        if not len(motion.time):
            return events
        if not self.worm:
            return {"time": motion.time, **self._own, **events}
        model = motion.system.model
        expressions = chain_expressions(model)
        if any(output.name == "command" for output in model.outputs):
            expressions["command"] = model["command"]
        return {"time": motion.time, **fitted(sample(motion, expressions), _SIGNALS), **events}

    @property
    def _own(self) -> dict[str, Variable]:
        """Every named state and output of a user's model."""
        return own_variables([self.motion], own_signals(self.motion.system.model), self.units)

    @attributes
    def shown(self) -> dict[str, Any]:
        model = self.motion.system.model
        names = [*(_SHOWN if self.worm else own_signals(model))]
        if not model.contacts:
            names = [name for name in names if name != "contact_force"]
        return {
            "contacts": [contact.name for contact in model.contacts],
            "signals": names if len(self.motion.time) else [],
        }

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def checks_of_motion(self) -> Iterator[Check]:
        yield from chain_checks(self.recheck, self.energies, self.tolerance.options)

    @warnings
    def doubts(self) -> Iterator[str]:
        system = self.motion.system
        laws = laws_of(self.worm) if self.worm else [contact.law for contact in system.contacts]
        yield from warnings_of_contact(system.treatment, laws)
        yield from warnings_of_motion(self.motion, self.recheck)

    @facts
    def simulation(self) -> dict[str, Any]:
        if self.worm:
            return chain_facts(
                [self.motion], [self.recheck], self.tolerance.options, [self.energies]
            )
        return motion_facts([self.motion], [self.recheck], self.tolerance.options)
