"""Kind "slide": the optimal motion of a block on dry ground."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

from wormopt.errors import Fault, SolveError
from wormopt.quantities import Scalar, unit_of
from wormopt.study import (
    Given,
    entry,
    number,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    warnings,
)
from wormopt.study.numerics import ContactTable, ExactContact, MeshTable, SmoothContact
from wormopt.systems.chain import Friction, faults_of_law, held_at_rest
from wormopt.systems.shared.optimal_motion import OptimalMotion

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.model.friction import Coulomb
    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.contact import Complementarity, FixedModes, Regularised
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.motion import Guess
    from wormopt.ocp.nlp import Ipopt
    from wormopt.ocp.optimise import Optimum, optimise, refine
    from wormopt.ocp.problem import Constraint, Ends, Problem
    from wormopt.ocp.switching import optimise_switching_times, structure_of
    from wormopt.simulation.options import Treatment
    from wormopt.systems.block.block import Phases, Transfer
    from wormopt.systems.chain import law_of
    from wormopt.systems.shared.optimum import ACCEPTED, warnings_of_reading
    from wormopt.systems.shared.proof import warnings_of_contact

# Upper limit of the duration, in multiples of a simple motion.
_LONGEST = 10.0
# If less of the drive than this share accelerates the block, relaxed contact hides the phases: it
# allows friction to be smaller by a thousandth of the drive and more.
_RELAXED_BELOW = 0.05
# A smaller share of the objective is no improvement.
_SAME = 1e-9
# First width of the smooth law, in usual speeds, and number of mesh refinements.
_WIDE, _ROUNDS = 0.1, 8
# Accepted end error of a simulation, in defects of a single arc.
_DEFECTS = 1e2


class Place(Given):
    """Position and velocity of the block."""

    position: float = number("length", "place")
    velocity: float = number("speed", "velocity at this position", default=0.0)


class Block(Given):
    """The block."""

    mass: float = positive("mass", "mass", default=1.0)
    force: float = positive("force", "largest drive in both directions")
    friction: Friction = entry("friction law of the ground")


@dataclass(frozen=True)
class Signals:
    """Motion of the block."""

    instant: np.ndarray = signal("time", "instant", "time")
    position: np.ndarray = signal("length", "instant", "position of the block")
    velocity: np.ndarray = signal("speed", "instant", "velocity of the block")
    force: np.ndarray = signal("force", "instant", "drive")
    contact_force: np.ndarray = signal("force", "instant", "force of the ground")


class Slide(OptimalMotion, kind="slide"):
    """Move a block on dry friction in minimum time or with minimum effort.

    A block on the ground moves from one position and velocity to another in the shortest time, or
    with the least effort ∫*u*² d*t*. See [optimal.md](../optimal.md).

    `contact` with `treatment = "exact"`: relaxed complementarity, then phases with free switching
    times; with `"smooth"`: phases of the drive only.

    The arrays contain the instants at which arcs join twice.
    """

    pictures: ClassVar = {
        "signals": ("signals over time", "wormopt.systems.chain.pictures:signals"),
    }
    keys_of_names: ClassVar = {"force": "block.force", "arcs": "mesh.arcs"}

    block: Block = entry("the block")
    start: Place = entry("initial state")
    end: Place = entry("final state")
    minimise: Literal["time", "effort"] = entry("minimised quantity", default="time")
    time: float | None = positive(
        "time", 'upper limit of the duration; required for `"effort"`', default=None
    )
    contact: ContactTable = entry("how contact is treated; exact if left out", default=ExactContact)
    mesh: MeshTable = entry("mesh in time", default=MeshTable)

    def faults_of_keys(self) -> Iterator[Fault]:
        wrong = list(faults_of_law("block.friction", self.block.friction, 1))
        yield from wrong
        if not wrong and self.start != self.end and isinstance(self.contact, ExactContact):
            yield from self._faults_of_drive()
        if self.start == self.end:
            yield "end", "equals the start; write another position or velocity"
        if self.minimise == "effort" and self.time is None:
            yield (
                "time",
                "missing, and the least effort takes infinite time; write the longest allowed "
                "duration",
            )

    def _faults_of_drive(self) -> Iterator[Fault]:
        """Yield a fault if the drive cannot start the block from rest in the required direction."""
        forward, backward = held_at_rest(self.block.friction)
        for way, name, held in ((1, "forward", forward), (-1, "backward", backward)):
            ahead = way * (self.end.position - self.start.position)
            first, last = way * self.start.velocity, way * self.end.velocity
            from_rest = first <= 0 <= ahead or (last > 0 and (first <= 0 or ahead <= 0))
            if from_rest and self.block.force <= held:
                more = f"write more than {held:.12g}, or " if held < math.inf else "write "
                yield (
                    "block.force",
                    f"{self.block.force:.12g} does not move the block {name} from rest against "
                    f"this friction, which is necessary to get from start to end; {more}another "
                    "end",
                )

    # -- the problem -------------------------------------------------------------------------------

    @cached_property
    def transfer(self) -> Transfer:
        """Task of the block."""
        start, end = ((at.position, at.velocity) for at in (self.start, self.end))
        width = self.contact.v_reg if isinstance(self.contact, SmoothContact) else None
        body = self.block
        return Transfer(law_of(body.friction), body.mass, body.force, start, end, width)

    @cached_property
    def phases(self) -> Phases | None:
        """Phases of the best slide and a motion near it; None if theory does not know them."""
        return self.transfer.phases(least_effort=self.minimise == "effort")

    @property
    def guess(self) -> Guess:
        """First guess where the phases are unknown."""
        return self.transfer.cubic(self.transfer.plain_time if self.time is None else self.time)

    @cached_property
    def problem(self) -> Problem:
        """Optimal-control problem of the block; names of bounds are keys of the scene."""
        slow = self.transfer.plain_time if self.phases is None else self.phases.guess.duration
        model, effort = self.transfer.model(slow), self.minimise == "effort"
        ends = Ends.of(model, int(effort))
        sizes = np.array([s.nominal for s in model.x])
        at_ends = [
            Constraint(
                f"{name}.{signal.name}", state[k] / sizes[k], value / sizes[k], value / sizes[k]
            )
            for name, place, state in (
                ("start", self.transfer.start, ends.start),
                ("end", self.transfer.end, ends.end),
            )
            for k, (signal, value) in enumerate(zip(model.x, place, strict=True))
        ]
        longest = _LONGEST * slow
        if self.time is not None:
            at_ends.append(Constraint("time", ends.duration, upper=self.time, nominal=self.time))
            longest = max(longest, 2 * self.time)
        # Integrals are variables of the program, so they are scaled to the size of 1.
        size = model.u[0].nominal ** 2 * slow if effort else slow
        return Problem(
            model,
            ends,
            size * ends.integrals[0] if effort else ends.duration,
            (1e-6 * slow, longest),
            integrands=ca.sumsqr(model["force"]) / size if effort else ca.SX(0, 1),
            boundary_constraints=at_ends,
            nominal=size,
        )

    # -- solving -----------------------------------------------------------------------------------

    def solve(self) -> dict[str, Optimum]:
        """Solve with relaxed contact and then in phases, or in phases at once."""
        problem, mesh, known, contact = self.problem, self.mesh, self.phases, self.contact
        plain = Mesh.even(1, mesh.arcs, Collocation(mesh.degree, mesh.scheme))
        if isinstance(contact, SmoothContact):
            if known is not None and self.minimise == "time":
                return {"phases": self._switched(contact, known.guess, known.active)}
            width, size = contact.v_reg, problem.model.x[1].nominal
            smoothed = Regularised(width, max(width, _WIDE * size))
            coarse = optimise(problem, plain, smoothed, self.guess, report=self.report)
            found = structure_of(coarse.motion, speed=None, least=2)
            guess = replace(coarse.motion.guess, phases=found.durations)
            return {"smooth": coarse, "switched": self._switched(contact, guess, found.active)}
        if known is not None and known.excess < _RELAXED_BELOW:
            return {"phases": self._in_phases(known)}
        try:
            only_phases = Complementarity(residual=1e-3, first=1e-1)
            relaxed = optimise(problem, plain, only_phases, self.guess, report=self.report)
            read = optimise_switching_times(relaxed, tolerance=mesh.tolerance)
        except SolveError as error:
            if known is None or error.code in ("bad_guess", "unbounded", "late"):
                raise
            return {"phases": self._in_phases(known)}
        return {"relaxed": relaxed, "phases": self._better(known, read)}

    def _better(self, known: Phases | None, read: Optimum) -> Optimum:
        """Return the better local optimum: from relaxed contact, or from known phases."""
        if known is None:
            return read
        try:
            found = self._in_phases(known)
        except SolveError:
            return read
        gained = read.objective - found.objective
        return found if gained > _SAME * abs(read.objective) else read

    def _in_phases(self, known: Phases) -> Optimum:
        """Solve with known phases, from a motion near the best one."""
        near = self.minimise == "time"  # the guess is then the best motion
        if near and not isinstance(self.transfer.law, Coulomb):
            mesh = self._mesh_of(known.guess)
        else:
            mesh = Mesh.even(len(known.modes.phases), 1, Collocation(5), 3)
        solver = Ipopt(tolerance=1e-10, mu_init=1e-5 if near else 1e-2, warm=near, rescale=False)
        contact, report = FixedModes(known.modes, known.active), self.report
        found = optimise(self.problem, mesh, contact, known.guess, solver=solver, report=report)
        return refine(found, self.mesh.tolerance, solver=solver, report=report)

    def _switched(
        self, contact: SmoothContact, guess: Guess, active: tuple[tuple[int, ...], ...]
    ) -> Optimum:
        """Let the drive switch at any time: phases end where it reaches or leaves a limit."""
        solver, width = Ipopt(tolerance=1e-11, mu_init=1e-2), contact.v_reg
        smoothed, mesh = Regularised(width, width, active=active), self._mesh_of(guess)
        found = optimise(self.problem, mesh, smoothed, guess, solver=solver, report=self.report)
        return refine(found, self.mesh.tolerance, rounds=_ROUNDS, solver=solver, report=self.report)

    def _mesh_of(self, guess: Guess) -> Mesh:
        """Return the mesh on the phases of a guess."""
        assert guess.phases is not None
        mesh, shares = self.mesh, guess.phases / np.sum(guess.phases)
        arcs = tuple(max(2, round(mesh.arcs * float(share))) for share in shares)
        return Mesh.even(len(arcs), arcs, Collocation(mesh.degree, mesh.scheme))

    # -- results -----------------------------------------------------------------------------------

    def expressions(self) -> dict[str, ca.SX]:
        model = self.motion.program.problem.model
        signals = {name: model[name] for name in ("position", "velocity", "force")}
        return {**signals, "contact_force": model.forces}

    @parts(Signals)
    def signals(self) -> Signals:
        return Signals(**self.sampled)

    @scalar(
        "time",
        'minimised quantity: the time, or with `minimise = "effort"` the effort (force² time)',
        headline=True,
    )
    def objective(self) -> Scalar:
        return Scalar(self.optimum.objective, unit_of(self.minimise, self.units))

    @property
    def treatment(self) -> Treatment:
        return self.contact.options

    @property
    def accepted(self) -> float:
        motion = self.motion
        arc = motion.program.arc
        rates = np.abs(motion.observe(arc.lawful_ode, motion.time)).max(axis=1) / arc.x_nominal
        # effect of rounding the duration on the states, in usual sizes
        rounding = 4 * np.finfo(float).eps * motion.duration * float(rates.max())
        return max(ACCEPTED, _DEFECTS * self.mesh.tolerance, rounding)

    @warnings
    def of_contact(self) -> Iterator[str]:
        yield from warnings_of_reading(next(iter(self.optimisation.optima.values())), self.optimum)
        yield from warnings_of_contact(self.treatment, [self.transfer.law])
