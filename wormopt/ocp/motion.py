"""A motion between and beyond collocation points: states, inputs, forces at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.labelled import SampledMotion
from wormopt.model.gait import Gait
from wormopt.model.given import check_number, make_plain
from wormopt.model.values import numbers
from wormopt.numerics.collocation import bernstein_matrix
from wormopt.ocp.mesh import Arcs, Mesh, interpolation
from wormopt.ocp.nlp import Bounds
from wormopt.ocp.transcription import Transcription

if TYPE_CHECKING:
    from wormopt.simulation.trajectory import Trajectory

Curve = Callable[[np.ndarray], np.ndarray]
"""Times, shape (m,), in; values, shape (rows, m), out."""


@dataclass(frozen=True)
class Guess:
    """First guess of a solver: curves over one motion.

    Parameters
    ----------
    duration : float
        Duration of the motion.
    states : callable
        States at times from 0 to ``duration``.
    inputs : callable, optional
        Inputs; zero if left out.
    forces : callable, optional
        Contact forces; zero if left out.
    phases : ndarray, shape (phases,), optional
        Durations of the phases; equal if left out.
    algebraic : callable, optional
        Algebraic variables; zero if left out.

    Raises
    ------
    ArgumentError
        If the duration is not positive and finite, a curve is not a function, or phases are not
        durations.

    Examples
    --------
    From 0 to 1 in 2 s at a constant velocity:

    >>> import numpy as np
    >>> guess = Guess(2.0, lambda t: np.vstack([t / 2, 0 * t + 0.5]))
    >>> guess.states(np.array([0.0, 1.0, 2.0]))
    array([[0. , 0.5, 1. ],
           [0.5, 0.5, 0.5]])
    """

    duration: float
    states: Curve
    inputs: Curve | None = None
    forces: Curve | None = None
    phases: np.ndarray | None = None
    algebraic: Curve | None = None

    def __post_init__(self) -> None:
        make_plain(self, "duration")
        check_number("duration", self.duration, above=0.0)
        for name in ("states", "inputs", "forces", "algebraic"):
            curve = getattr(self, name)
            if not callable(curve) and (name == "states" or curve is not None):
                raise ArgumentError(f"{name} must be a function of times, not {curve!r:.60}")
        if self.phases is None:
            return
        phases = numbers("phases", self.phases)
        if phases.ndim != 1 or not np.all(phases >= 0) or not 0 < np.sum(phases) < np.inf:
            raise ArgumentError(f"phases must be a list of durations, not {self.phases!r:.60}")
        object.__setattr__(self, "phases", phases)

    @classmethod
    def of(cls, trajectory: Trajectory) -> Guess:
        """Start at a simulated motion.

        Parameters
        ----------
        trajectory : Trajectory
            Simulated with ``dense = True``, of a model with the problem's states. Its output
            ``input``, where it has one as `drive` and trackers give, makes the inputs.

        Raises
        ------
        ArgumentError
            If it was simulated without ``dense = True``.

        Examples
        --------
        >>> from wormopt.simulation.simulate import simulate
        >>> from wormopt.systems.chain.build import chain
        >>> worm = chain(1, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0, drag=0.1)
        >>> guess = Guess.of(simulate(worm, 2.0, dense=True, x0={"position": [1.5, 0.0]}))
        >>> guess.duration, guess.states(np.array([0.0])).T.tolist()
        (2.0, [[1.5, 0.0, 0.0, 0.0]])
        """
        begin, end = float(trajectory.at(trajectory.time).time[0]), trajectory.end_time
        forces = trajectory.system.model.forces

        def at(t: np.ndarray) -> Trajectory:
            return trajectory.at(np.clip(begin + t, begin, end))

        return cls(
            end - begin,
            lambda t: at(t).states,
            (lambda t: at(t)["input"]) if "input" in trajectory.names else None,
            (lambda t: at(t).observe(forces)) if forces.numel() else None,
        )

    def durations_on(self, mesh: Mesh) -> np.ndarray:
        """Durations (N,) of a mesh's arcs.

        Parameters
        ----------
        mesh : Mesh
            Any mesh; arcs without shares are equally long within their phase.
        """
        phases = np.full(mesh.phases, 1.0) if self.phases is None else self.phases
        shares = mesh.shares or tuple(1 / n for n in mesh.counts for _ in range(n))
        return self.duration * np.array(shares) * (phases / np.sum(phases))[mesh.phase]


# Fewest instants of a motion in all and on each arc, and their distance from its ends.
_SAMPLES, _PER_ARC, _INSIDE = 400, 3, 1e-9
# Arcs of a smaller share of the motion have no duration.
_NOTHING = 1e-12


@dataclass(frozen=True, eq=False)
class Motion(SampledMotion):
    """A motion found on some mesh, as curves and by names.

    Parameters
    ----------
    program : Transcription
        The transcribed problem.
    arcs : Arcs
        The motion arc by arc.
    level : ndarray, shape (N, n_level)
        Levels of the treatment of contacts, per arc.
    schedules : ndarray, shape (N, n_schedules)
        Values of the model's schedules, per arc.
    p : ndarray, shape (n_p,)
        Parameters of the model.

    Examples
    --------
    A block that resists with 1 forward and 2 backward, pushed with at most 3, slides a unit way
    from rest to rest in sqrt(3/2) at least:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    >>> block = wo.Model(
    ...     "block",
    ...     x=[wo.Signal("position", x), wo.Signal("velocity", v)],
    ...     ode=ca.vertcat(v, u + f),
    ...     u=[wo.Signal("drive", u, lower=-3.0, upper=3.0)],
    ...     contacts=[wo.Contact("sole", v, f, wo.Coulomb(1.0, 2.0))],
    ... )
    >>> ends = wo.Ends.of(block)
    >>> start = wo.Constraint("start", ends.start, 0, 0)
    >>> rest = wo.Constraint("end", ends.end, [1, 0], [1, 0])
    >>> time = ends.duration
    >>> problem = wo.Problem(block, ends, time, (0.1, 10.0), boundary_constraints=[start, rest])
    >>> guess = wo.Guess(1.5, lambda t: np.vstack([t / 1.5, 0 * t + 0.7]))
    >>> mesh = wo.Mesh.even(2, 1, wo.Collocation(2))
    >>> slides = wo.FixedModes(wo.ModeSequence(((1,), (1,))))
    >>> found = wo.optimise(problem, mesh, slides, guess)
    >>> motion = found.motion
    >>> round(motion.duration**2, 9), motion.states(np.array([0.0, motion.duration]))[0].round(9)
    (1.5, array([0., 1.]))
    """

    program: Transcription
    arcs: Arcs
    level: np.ndarray
    schedules: np.ndarray
    p: np.ndarray

    __repr__ = SampledMotion.__repr__

    @property
    def _title(self) -> str:
        name, arcs = self.program.problem.model.name, self.mesh.total
        return f"Motion of {name} ({arcs} arcs in {self.mesh.phases} phases)"

    @classmethod
    def of(cls, program: Transcription, w: np.ndarray, bounds: Bounds) -> Motion:
        """Read a solution of a program.

        Parameters
        ----------
        program : Transcription
            The program.
        w : ndarray, shape (n_w,)
            Its variables.
        bounds : Bounds
            With which it was solved.
        """
        n, (level, schedules, _, p) = program.mesh.total, program.arc.constants
        edges = np.cumsum([level.numel() * n, schedules.numel() * n])
        levels, values, fixed = np.split(bounds.p, edges)
        assert len(fixed) == p.numel()
        shapes = (n, level.numel()), (n, schedules.numel())
        return cls(
            program, program.unpack(w), levels.reshape(shapes[0]), values.reshape(shapes[1]), fixed
        )

    @property
    def mesh(self) -> Mesh:
        """Mesh on which it was found."""
        return self.program.mesh

    @cached_property
    def breaks(self) -> np.ndarray:
        """Times at which arcs begin, and the end, shape (N + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.arcs.duration)])

    @property
    def duration(self) -> float:
        """Duration of the motion."""
        return float(self.breaks[-1])

    @cached_property
    def time(self) -> np.ndarray:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Instants (m,); joints of arcs with duration are duplicated, before and after."""
        lasting = np.flatnonzero(self.arcs.duration > _NOTHING * self.duration)
        places = np.linspace(0, 1, max(_PER_ARC, -(-_SAMPLES // len(lasting)) + 1))
        places[-1] -= _INSIDE  # so that each time belongs to its own arc
        t = (self.breaks[lasting, None] + self.arcs.duration[lasting, None] * places).ravel()
        t[-1] = self.duration
        return t

    @property
    def names(self) -> tuple[str, ...]:
        """Names of states and inputs, then of the model's outputs."""
        model = self.program.problem.model
        return tuple(dict.fromkeys(s.name for s in (*model.x, *model.u, *model.outputs)))

    def __getitem__(self, name: str) -> np.ndarray:
        """Samples (entries, m) of anything the model knows by name, at `time`."""
        return self.observe(self.program.problem.model[name], self.time)

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Parameters of the model by name."""
        signals = self.program.problem.parameters
        ends = np.cumsum([s.size for s in signals], dtype=int).tolist()
        return {s.name: self.p[e - s.size : e] for s, e in zip(signals, ends, strict=True)}

    def phase_breaks(self) -> np.ndarray:
        """Times at which phases begin, and the end, (phases + 1,)."""
        first = np.searchsorted(self.mesh.phase, np.arange(self.mesh.phases))
        return np.append(self.breaks[first], self.duration)

    # -- curves ----------------------------------------------------------------------------

    def _locate(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        t = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        arc = np.clip(np.searchsorted(self.breaks, t, side="right") - 1, 0, self.mesh.total - 1)
        while np.any(empty := self.arcs.duration[arc] <= 0):
            arc[empty] -= 1  # an arc without duration has no values
        return arc, (t - self.breaks[arc]) / self.arcs.duration[arc]

    def _interpolated(self, t: np.ndarray, nodes: np.ndarray, values: np.ndarray) -> np.ndarray:
        arc, s = self._locate(t)
        return np.einsum("mk,rkm->rm", interpolation(nodes, s), values[:, :, arc])

    def states(self, t: np.ndarray) -> np.ndarray:
        """States (n_x, m) at given times.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times from 0 to the duration.
        """
        return self._interpolated(t, self.mesh.collocation.nodes, self.arcs.states)

    def inputs(self, t: np.ndarray) -> np.ndarray:
        """Inputs (n_u, m) at given times; where they jump, the later value.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times from 0 to the duration.
        """
        arc, s = self._locate(t)
        return np.einsum("mk,rkm->rm", self.mesh.inputs_at(s), self.arcs.inputs[:, :, arc])

    def forces(self, t: np.ndarray) -> np.ndarray:
        """Contact forces (n_c, m) at given times.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times from 0 to the duration.
        """
        return self.observe(self.program.problem.model.forces, t)

    def algebraic(self, t: np.ndarray) -> np.ndarray:
        """Algebraic variables (n_z, m) at given times.

        Parameters
        ----------
        t : ndarray, shape (m,)
            Times from 0 to the duration.
        """
        return self._interpolated(t, self.mesh.collocation.tau, self.arcs.algebraic)

    def observe(self, expression: ca.SX, t: np.ndarray) -> np.ndarray:
        """Values (r, m) of an expression of the problem's symbols.

        Parameters
        ----------
        expression : casadi.SX
            Column of r entries: an output of the model, a contact force, a bound.
        t : ndarray, shape (m,)
            Times from 0 to the duration.
        """
        arc = self.program.arc
        function = ca.Function("observe", arc.symbols, [ca.densify(arc.at_forces(expression))])
        which, _ = self._locate(t)
        tau = self.mesh.collocation.tau
        at_points = [
            self._interpolated(t, tau, block)
            for block in (self.arcs.slacks, self.arcs.algebraic, self.arcs.unknowns)
        ]
        columns = [np.asarray(t)[None, :], self.states(t), self.inputs(t), *at_points]
        columns += [self.level[which].T, self.schedules[which].T]
        constants = [np.tile(c[:, None], len(which)) for c in (self.arcs.design, self.p)]
        return np.array(function(*columns, *constants))

    def state(self, name: str, t: np.ndarray) -> np.ndarray:
        """One of the model's states (entries, m) by its name.

        Parameters
        ----------
        name : str
            Name of a state.
        t : ndarray, shape (m,)
            Times from 0 to the duration.

        Raises
        ------
        ValueError
            If there is no such state.
        """
        return self.states(t)[self.program.rows_of(name)]

    def output(self, name: str, t: np.ndarray) -> np.ndarray:
        """One of the model's outputs (entries, m) by its name.

        Parameters
        ----------
        name : str
            Name of an output.
        t : ndarray, shape (m,)
            Times from 0 to the duration.

        Raises
        ------
        KeyError
            If there is no such output.
        """
        return self.observe(self.program.problem.model[name], t)

    @property
    def guess(self) -> Guess:
        """The motion as a start for another solve."""
        phases = np.diff(self.phase_breaks())
        return Guess(self.duration, self.states, self.inputs, self.forces, phases, self.algebraic)

    def input_course(self) -> Gait:
        """Inputs as piecewise polynomials of time, as simulation takes them.

        Returns
        -------
        Gait
            One row per input; arcs without duration are left out.
        """
        kept = np.flatnonzero(self.arcs.duration > 1e-12 * self.duration)
        nodes = self.mesh.input_nodes
        powers = np.arange(self.mesh.input_degree + 1)
        to_powers = np.linalg.inv(nodes[:, None] ** powers) @ np.linalg.inv(bernstein_matrix(nodes))
        pieces = np.einsum("kj,rjn->nrk", to_powers, self.arcs.inputs)[kept]
        pieces /= self.arcs.duration[kept, None, None] ** powers
        breaks = np.append(self.breaks[kept], self.duration)
        breaks[0] = 0.0
        return Gait(breaks, pieces)


def sample(program: Transcription, guess: Guess, bounds: Bounds) -> np.ndarray:
    """Variables (n_w,) of a program that follow a guess; `bounds` has integrals' parameters."""
    # Slacks and design constants are at nominal size, impulses zero.
    mesh, arc = program.mesh, program.arc
    n = mesh.total
    durations = guess.durations_on(mesh)
    breaks = np.concatenate([[0.0], np.cumsum(durations)])

    def on(curve: Curve | None, places: np.ndarray, rows: int) -> np.ndarray:
        if curve is None:
            return np.zeros((rows, len(places), n))
        t = breaks[:-1] + np.multiply.outer(places, durations)
        values = np.asarray(curve(t.ravel()))
        if values.shape != (rows, t.size):
            raise ArgumentError(
                f"a curve of the guess gives shape {values.shape} at {t.size} times; it must give "
                f"({rows}, {t.size})"
            )
        return values.reshape(rows, len(places), n)

    n_x, n_u = len(arc.x_nominal), len(arc.u_nominal)
    inner = (np.arange(mesh.input_degree + 1) + 0.5) / (mesh.input_degree + 1)  # off the breaks
    to_coefficients = np.linalg.inv(mesh.inputs_at(inner))
    points = on(guess.states, mesh.collocation.tau, n_x)
    forces = on(guess.forces, mesh.collocation.tau, len(arc.f_nominal))
    arcs = Arcs(
        duration=durations,
        start=on(guess.states, np.zeros(1), n_x)[:, 0],
        points=points,
        inputs=np.einsum("kj,rjn->rkn", to_coefficients, on(guess.inputs, inner, n_u)),
        algebraic=on(guess.algebraic, mesh.collocation.tau, len(arc.z_nominal)),
        unknowns=arc.closure_start(points, forces),
        jumps=np.zeros((arc.layout.jumps.stop - arc.layout.jumps.start, n)),
        **program.nominal_extras(),
    )
    return program.pack(arcs, bounds)
