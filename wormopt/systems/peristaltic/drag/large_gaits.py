"""The best gait of a worm on drag at any amplitude, by collocation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.ocp.contact import FixedModes
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess, Motion
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.optimise import Optimum, optimise_multistart, refine
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.progress import Report, silent
from wormopt.systems.peristaltic.drag.small_gaits import Cost, SmallGait, small_gaits
from wormopt.systems.peristaltic.drag.worm import drag_worm

_SOLVER = Ipopt(tolerance=1e-12)
_ROUNDS = 4
SHORTEST = 0.1
"""Default least length of a segment over L: the best gait may shorten it to 0."""
# Largest share of the room to a limit of the lengths that a guess uses.
_INSIDE = 0.9


@dataclass(frozen=True)
class DragAim:
    """A worm on drag, and the effort and limits of its gait.

    Parameters
    ----------
    segments : int
        Number of segments N.
    exponent : float
        Exponent a of the drag law c0 (l / L)^a.
    cost : {"strain_rate", "dissipation"}
        Kind of effort that is limited.
    effort : float
        Effort allowed per period: 1 / time for strain rates, an energy for dissipation.
    period, length, drag : float, optional
        Period, L and c0.
    mean : float, optional
        Mean length of each segment over the period; free if left out.
    keeps_length : bool, optional
        Whether the total length of the worm is constant.
    limits : (float, float), optional
        Least and largest length of a segment.

    Examples
    --------
    >>> aim = DragAim(3, 1.0, "strain_rate", 10.0, mean=1.0)
    >>> aim.model.name, round(aim.small[0].way(1.0, aim.effort), 6)
    ('worm of 3 segments on drag', 0.265258)
    """

    segments: int
    exponent: float
    cost: Cost
    effort: float
    period: float = 1.0
    length: float = 1.0
    drag: float = 1.0
    mean: float | None = None
    keeps_length: bool = False
    limits: tuple[float, float] = (SHORTEST, float("inf"))

    @property
    def model(self) -> Model:
        """Model of the worm."""
        least, most = self.limits
        return drag_worm(
            self.segments, self.exponent, length=self.length, drag=self.drag,
            total=self.segments * self.middle if self.keeps_length else None,
            least=least, most=most, time_nominal=self.period, strain=self.strain,
        )  # fmt: skip

    @property
    def middle(self) -> float:
        """Length about which an initial guess oscillates."""
        return sum(self.limits) / 2 if self.mean is None else self.mean

    @property
    def power(self) -> str:
        """Name of the output whose integral is the effort."""
        return "strain_power" if self.cost == "strain_rate" else "dissipation"

    @property
    def small(self) -> list[SmallGait]:
        """Optimal gaits for small effort."""
        return small_gaits(self.segments, self.exponent, self.cost, fixed_total=self.keeps_length)

    @property
    def strain(self) -> float:
        """Usual strain: the largest of the best small gait, 1 if lengths have no mean."""
        if self.mean is None:
            return 1.0
        small = self.small[0].scaled(self.strain_effort, self.period)
        return min(1.0, float(np.abs(small).max()))

    @property
    def small_way(self) -> float:
        """Displacement per period by the theory of small strains about the middle length."""
        return self.small[0].way(self.exponent, self.strain_effort, self.middle, self.period)

    @property
    def scaled(self) -> DragAim:
        """The aim in units of length L, period and c0."""
        L, small = self.length, self.period / self.length**2 / self.drag
        return replace(
            self,
            effort=self.effort * (self.period if self.cost == "strain_rate" else small),
            period=1.0,
            length=1.0,
            drag=1.0,
            mean=self.mean and self.mean / L,
            limits=(self.limits[0] / L, self.limits[1] / L),
        )

    @property
    def strain_effort(self) -> float:
        """The effort in strains about the middle length: integral of e'^T M e'."""
        size = (self.middle / self.length) ** 2
        if self.cost == "strain_rate":
            return self.effort / size
        stiff = self.drag * (self.middle / self.length) ** self.exponent
        return self.effort / (stiff * self.middle**2)


def gait_problem(aim: DragAim) -> Problem:
    """Return the problem: largest displacement per period within the effort."""
    model = aim.model
    rows = model["length"] if aim.mean is not None else ca.SX(0, 1)
    count = rows.numel()
    ends = Ends.of(model, count + 1)
    unit = aim.strain * aim.length * aim.period
    bounds = [
        Constraint("start", ends.start[-1], 0.0, 0.0, aim.small_way),
        Constraint("budget", ends.integrals[count], upper=aim.effort, nominal=aim.effort),
    ]
    if aim.mean is not None:
        mean = aim.mean * aim.period
        bounds.append(Constraint("mean length", ends.integrals[:count], mean, mean, unit))
    least, most = aim.limits
    return Problem(
        model,
        ends,
        -(ends.end[-1] - ends.start[-1]) / aim.small_way,
        (aim.period, aim.period),
        periodic=["length"],
        integrands=ca.vertcat(rows, model[aim.power]),
        path_constraints=[Constraint("last length", model["lengths"][-1], least, most, aim.length)]
        if aim.keeps_length
        else [],
        boundary_constraints=bounds,
    )


def first_gait(aim: DragAim, small: SmallGait) -> Gait:
    """Return a small gait at the given effort, or smaller near limits."""
    middle, (least, most) = aim.middle, aim.limits
    reach = middle * np.abs(small.scaled(aim.strain_effort, aim.period)).max()
    shrink = min(1.0, _INSIDE * min(middle - least, most - middle) / reach)
    return small.gait(aim.strain_effort * shrink**2, middle, aim.period)


def guess_of(aim: DragAim, small: SmallGait) -> Guess:
    """Return a small gait as a guess."""
    gait, free = first_gait(aim, small), aim.segments - aim.keeps_length
    return Guess(
        aim.period, lambda t: np.vstack([gait(t)[:free], 0 * t]), lambda t: gait(t, 1)[:free]
    )


def best_gait(
    aim: DragAim, mesh: Mesh, tolerance: float, *, starts: int = 1, report: Report = silent
) -> tuple[Optimum, tuple[float, ...]]:
    """Find the best gait from the `starts` best small ones, on a refined mesh.

    Theory: docs/theory-peristaltic.md, section 4.

    Parameters
    ----------
    aim : DragAim
        The worm, its effort and limits.
    mesh : Mesh
        Initial mesh.
    tolerance : float
        Largest local error, to which the mesh is refined.
    starts : int, optional
        Number of small gaits to start from.
    report : callable, optional
        Called with the current step and the share completed.

    Returns
    -------
    Optimum, tuple of float
        The best gait, whose objective is the negative displacement over L, and the objectives of
        all starts.

    Raises
    ------
    SolveError
        If no gait is found.

    Examples
    --------
    >>> from wormopt.numerics.collocation import Collocation
    >>> mesh = Mesh.even(1, 6, Collocation(6, "legendre"), 5)
    >>> aim = DragAim(2, 1.0, "strain_rate", 10.0, mean=1.0)
    >>> round(-best_gait(aim, mesh, 1e-5)[0].objective * aim.small_way, 6)
    0.209754
    """
    guesses = [guess_of(aim, small) for small in aim.small[:starts]]
    best, tried = optimise_multistart(
        gait_problem(aim), mesh, FixedModes(), guesses, solver=_SOLVER, report=report
    )
    return refine(best, tolerance, rounds=_ROUNDS, solver=_SOLVER, report=report), tried


def touches(motion: Motion, aim: DragAim, within: float = 1e-6) -> bool:
    """Return whether a segment reaches a limit of its length, to a share of the usual length."""
    lengths = motion.output("lengths", np.linspace(0, motion.duration, 2001))
    least, most = aim.limits
    near = within * aim.length
    return bool(lengths.min() < least + near or lengths.max() > most - near)
