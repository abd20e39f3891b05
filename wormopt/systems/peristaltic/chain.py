"""A worm of membrane segments in a row, with their ends as masses, on the ground or in a tube.

Rings x_0 > ... > x_N are point masses; segment j lies between rings j and j + 1 and contributes
half of its mass to each. Its pull is that of membrane, coil and dashpot, less the push of the
tube's wall. All energies and their powers are outputs. Grounds are dry, a viscous film, or a tube
with a compliant wall; their forces are in N, lengths in m, for numbers, arrays or CasADi
expressions.
Source: section 3.5 of K. Zimmermann et al., "Worm-like Locomotion Systems (WLLS)", 2007;
docs/theory-peristaltic.md, section chain.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import ArgumentError
from wormopt.magnetics.material import check_number
from wormopt.magnetics.pressure import magnetic_pressure
from wormopt.model.friction import Coulomb, Viscous
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.model.values import numbers
from wormopt.quantities import GRAVITY
from wormopt.systems.peristaltic.segment import Anchoring, Segment
from wormopt.systems.peristaltic.tables import Tube


@dataclass(frozen=True, eq=False)
class DryGround:
    """Open ground with dry friction.

    Parameters
    ----------
    forward, backward : float, sequence or expression
        Friction coefficients against forward and backward motion; one value, or one per contact.

    Examples
    --------
    >>> DryGround(0.1, 0.3).law(0, 2.0).backward
    0.6
    """

    forward: Any
    backward: Any

    def law(self, contact: int, weight: Any) -> Coulomb:
        """Return the friction law of a contact.

        Parameters
        ----------
        contact : int
            Index of the contact, from 0 at the head.
        weight : Any
            Weight on the contact, N.
        """
        ahead, behind = (_of(given, contact) * weight for given in (self.forward, self.backward))
        return Coulomb(ahead, behind)


@dataclass(frozen=True)
class DragGround:
    """Viscous ground: drag c0 (l / L)^a times velocity at the middles of segments.

    Parameters
    ----------
    coefficient : float
        c0, N s/m.
    exponent : float, optional
        a: if positive long segments grip, if negative short and thick ones, at 0 none.

    Raises
    ------
    ArgumentError
        If c0 is not above 0.

    Examples
    --------
    >>> DragGround(0.2, -1.0).law(0.5)
    Viscous(drag=0.4)
    """

    coefficient: float
    exponent: float = 1.0

    def __post_init__(self) -> None:
        check_number("coefficient", self.coefficient)

    def law(self, stretch: Any) -> Viscous:
        """Return the drag law of a segment.

        Parameters
        ----------
        stretch : Any
            Length over unstressed length.
        """
        return Viscous(self.coefficient * stretch**self.exponent)


@dataclass(frozen=True)
class Bed:
    """A tube with a compliant wall, p = k (r - R_t), so that the state determines wall forces.

    The wall lengthens a segment of volume V and radius r with the force p pi r², and presses on it
    with p 2 pi r l = 2 p V / r; energy is conserved. The rigid tube is the limit of large k.

    Parameters
    ----------
    tube : Tube
        The undeformed tube.
    stiffness : float
        k, Pa/m.

    Raises
    ------
    ArgumentError
        If k is not above 0.

    Examples
    --------
    >>> segment, bed = Segment(20e-3, 5e-3, 0.3e-3, 20e3), Bed(Tube(5.05e-3, 0.3), 1e8)
    >>> bed.pressure(segment, 1.0) == 0, round(bed.pressure(segment, 0.98), 1)
    (True, 76.3)
    """

    tube: Tube
    stiffness: float

    def __post_init__(self) -> None:
        check_number("stiffness", self.stiffness)

    def pressure(self, segment: Segment, stretch: Any) -> Any:
        """Return the pressure of the wall on a sealed segment, in Pa; 0 without contact.

        Parameters
        ----------
        segment : Segment
            Sealed segment, thinner than the tube.
        stretch : float, ndarray or expression
            Length over unstressed length.
        """
        depth = segment.radius_at(stretch) - self.tube.radius
        return self.stiffness * depth * (depth > 0)

    def push(self, segment: Segment, stretch: Any) -> Any:
        """Return the axial force by which the wall lengthens the segment, in N.

        Parameters
        ----------
        segment, stretch : Any
            See `pressure`.
        """
        area = math.pi * segment.radius_at(stretch) ** 2
        return area * self.pressure(segment, stretch)

    def normal_force(self, segment: Segment, stretch: Any) -> Any:
        """Return the force of the wall on the segment's whole surface, in N.

        Parameters
        ----------
        segment, stretch : Any
            See `pressure`.
        """
        pressure = self.pressure(segment, stretch)
        return 2 * segment.volume * pressure / segment.radius_at(stretch)

    def energy(self, segment: Segment, stretch: Any) -> Any:
        """Return the energy of the wall, 2 V k (d - R_t log(1 + d / R_t)) at the depth d, in J.

        Parameters
        ----------
        segment, stretch : Any
            See `pressure`.
        """
        room = self.tube.radius
        depth = segment.radius_at(stretch) - room
        depth = depth * (depth > 0)
        return 2 * segment.volume * self.stiffness * (depth - room * ca.log1p(depth / room))

    def law(self, weight: Any, pressed: Any) -> Coulomb:
        """Return the friction law of a contact.

        Parameters
        ----------
        weight, pressed : Any
            Weight on the contact, and normal force of the wall, N.
        """
        limit = self.tube.friction * (weight + pressed)
        return Coulomb(limit, limit)


Ground = DryGround | DragGround | Bed


def _of(given: Any, contact: int) -> Any:
    """Return the value of one contact, from one value for all or one for each."""
    several = isinstance(given, Sequence) or (isinstance(given, ca.SX) and given.numel() > 1)
    return given[contact] if several else given


POWERS = ("coil", "damping", "drag", "friction", "load")
"""Sources of work on the rings: outputs ``<name>_power``, states ``<name>_work``."""

# Usual strain, by which solvers scale positions, velocities and works.
_STRAIN = 0.01


@dataclass(frozen=True, eq=False)
class Body:
    """Segments of a worm and their common parameters, in SI units.

    Parameters
    ----------
    segments : sequence of Segment
        Segments, head first.
    mass, damping : array_like, shape (N,)
        Mass (kg) of each segment, and damping along it (N s/m); a single value holds for all.
    mu_r : float, optional
        Relative permeability of the fluid.
    field_per_current : float, optional
        Field per current of each coil, 1/m; if left out, the inputs are fields.
    gravity : float, optional
        Acceleration of gravity, m/s².
    load : float, optional
        Force against forward motion, N, distributed over the rings like their mass.

    Raises
    ------
    ArgumentError
        If a value is out of range.

    Examples
    --------
    >>> Body([Segment(20e-3, 5e-3, 0.3e-3, 20e3)] * 2, mass=2e-3).ring_masses
    array([0.001, 0.002, 0.001])
    """

    segments: Sequence[Segment]
    mass: ArrayLike
    damping: ArrayLike = 0.0
    mu_r: float = 1.35
    field_per_current: float | None = None
    gravity: float = GRAVITY
    load: float = 0.0

    def __post_init__(self) -> None:
        n = len(self.segments)
        for name in ("mass", "damping"):
            given = numbers(name, getattr(self, name))
            if given.size not in (1, n):
                raise ArgumentError(f"{name} has {given.size} numbers for {n} segments; give {n}")
            if not (np.all(given > 0) or (name == "damping" and np.all(given == 0))):
                raise ArgumentError(f"{name} must be positive")

    def per_segment(self, name: str) -> np.ndarray:
        """Return mass or damping of every segment, (N,).

        Parameters
        ----------
        name : {"mass", "damping"}
            Quantity to return.
        """
        return np.broadcast_to(numbers(name, getattr(self, name)).ravel(), len(self.segments))

    @property
    def ring_masses(self) -> np.ndarray:
        """Half of the mass of both neighbours, (N + 1,), in kg."""
        return _halves(self.per_segment("mass"))

    @property
    def length(self) -> float:
        """Mean unstressed length of a segment, in m."""
        return float(np.mean([segment.length for segment in self.segments]))

    @property
    def nominal_speed(self) -> float:
        """Usual speed of a ring: that of a small strain at the frequency of a segment."""
        pulls = 3 * np.array([segment.stiffness for segment in self.segments])
        return float(_STRAIN * np.sqrt(np.mean(pulls) * self.length / np.mean(self.ring_masses)))

    @property
    def nominal_work(self) -> float:
        """Usual energy: that of all membranes at a small strain."""
        each = [segment.stiffness * segment.length for segment in self.segments]
        return float(_STRAIN**2 * np.sum(each))


def peristaltic_worm(body: Body, ground: Ground, anchoring: Anchoring = "mid") -> Model:
    """Build the Model of a worm of N segments.

    States are ``position`` and ``velocity`` (N + 1 each), inputs ``current`` or ``field`` (N).
    Outputs per segment are ``length``, ``stretch``, ``radius``, ``magnetic_pressure``,
    ``wall_pressure``, and ``normal_force`` of the wall; per contact ``limit_forward``,
    ``limit_backward``; ``center`` of mass, ``kinetic_energy``, ``elastic_energy``, ``wall_energy``
    and the powers of `POWERS`. All are in SI units.

    Theory: docs/theory-peristaltic.md, section 2.

    Parameters
    ----------
    body : Body
        The worm.
    ground : DryGround, DragGround or Bed
        Open ground, or a tube.
    anchoring : {"mid", "clamp"}, optional
        Contact of a segment: its middle, or its rings; drag acts at its middle.

    Returns
    -------
    Model
        A model with one contact per segment, or per ring.

    Raises
    ------
    ArgumentError
        If the anchoring is unknown or a segment does not fit into the tube.

    Examples
    --------
    >>> segment = Segment(20e-3, 5e-3, 0.3e-3, 20e3)
    >>> body = Body([segment] * 4, mass=1200 * segment.volume, damping=0.15)
    >>> model = peristaltic_worm(body, DryGround(0.1, 0.3))
    >>> model.n_x, [contact.name for contact in model.contacts][:2]
    (10, ['segment 0', 'segment 1'])
    """
    if anchoring not in get_args(Anchoring):
        raise ArgumentError(f"anchoring must be mid or clamp, not {anchoring!r}")
    n, rings = len(body.segments), body.ring_masses
    x, v = ca.SX.sym("x", n + 1), ca.SX.sym("v", n + 1)
    inputs = _inputs(body)
    field = inputs.symbol * (body.field_per_current or 1.0)
    pressure = ca.SX(magnetic_pressure(body.mu_r, field))
    lengths, rates = x[:-1] - x[1:], v[:-1] - v[1:]
    wall = _Walled(ground, body.segments, lengths)
    coil, elastic, stored = _membranes(body.segments, wall.stretches, pressure)
    damping, load = ca.DM(body.per_segment("damping")), body.load * rings / rings.sum()
    contacts = _contacts(body, ground, anchoring, v, wall)
    pull = coil + elastic + damping * rates - wall.push
    forces = -_along(rates, v, pull) - ca.DM(load)
    forces += _along(_column(c.velocity for c in contacts), v, _column(c.force for c in contacts))
    start = -np.cumsum([0.0, *(segment.length for segment in body.segments)])
    return Model(
        f"peristaltic worm of {n} segments",
        x=[
            Signal("position", x, "length", _STRAIN * body.length, value=start.tolist()),
            Signal("velocity", v, "speed", body.nominal_speed, value=0.0),
        ],
        ode=ca.vertcat(v, forces / ca.DM(rings)),
        u=[inputs],
        contacts=contacts,
        outputs=[
            Output("length", lengths, "length"),
            Output("stretch", wall.stretches),
            Output("radius", wall.radii, "length"),
            Output("magnetic_pressure", pressure, "stress"),
            Output("wall_pressure", wall.pressure, "stress"),
            Output("normal_force", wall.normal_force, "force"),
            *_limits(contacts, drags=isinstance(ground, DragGround)),
            Output("center", ca.dot(ca.DM(rings), x) / rings.sum(), "length"),
            Output("kinetic_energy", ca.dot(ca.DM(rings), v**2) / 2, "energy"),
            Output("elastic_energy", stored, "energy"),
            Output("wall_energy", wall.energy, "energy"),
            Output("coil_power", -ca.dot(coil, rates), "power"),
            Output("damping_power", -ca.dot(damping, rates**2), "power"),
            *_ground_powers(contacts, drags=isinstance(ground, DragGround)),
            Output("load_power", -ca.dot(ca.DM(load), v), "power"),
        ],
    )


# -- segments ------------------------------------------------------------------------------------


def _inputs(body: Body) -> Signal:
    n = len(body.segments)
    if body.field_per_current is None:
        return Signal("field", ca.SX.sym("field", n), "magnetic_field", 1e4, value=0.0)
    nominal = 1e4 / body.field_per_current
    return Signal("current", ca.SX.sym("current", n), "current", nominal, value=0.0)


def _membranes(
    segments: Sequence[Segment], stretches: ca.SX, pressure: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return pulls of coils and membranes, and the membranes' energy."""
    each = list(enumerate(segments))
    coil = _column(s.coil_pull(stretches[j], pressure[j]) for j, s in each)
    elastic = _column(s.elastic_pull(stretches[j]) for j, s in each)
    return coil, elastic, ca.sum1(_column(s.energy(stretches[j]) for j, s in each))


class _Walled:
    """Segments at their present lengths, and the action of a tube's wall on them."""

    def __init__(self, ground: Ground, segments: Sequence[Segment], lengths: ca.SX) -> None:
        each = [(s, lengths[j] / s.length) for j, s in enumerate(segments)]
        self.stretches = _column(stretch for _, stretch in each)
        self.radii = _column(s.radius_at(stretch) for s, stretch in each)
        nothing = ca.SX.zeros(len(each))
        self.pressure = self.push = self.normal_force = nothing
        self.energy = ca.SX(0)
        if isinstance(ground, Bed):
            for segment in segments:
                ground.tube.stretch_at_contact(segment)  # refuses segments that do not fit
            self.pressure = _column(ground.pressure(*one) for one in each)
            self.push = _column(ground.push(*one) for one in each)
            self.normal_force = _column(ground.normal_force(*one) for one in each)
            self.energy = ca.sum1(_column(ground.energy(*one) for one in each))


# -- ground --------------------------------------------------------------------------------------


def _contacts(
    body: Body, ground: Ground, anchoring: Anchoring, v: ca.SX, wall: _Walled
) -> list[Contact]:
    """Return contacts: at middles of segments (drag always), or at rings."""
    middle, n = anchoring == "mid" or isinstance(ground, DragGround), len(body.segments)
    weight = body.per_segment("mass") * body.gravity
    if middle:
        velocities, pressed, what = (v[:-1] + v[1:]) / 2, wall.normal_force, "segment"
    else:
        velocities, pressed, what = v, _halves(wall.normal_force), "ring"
        weight = _halves(weight)
    found = []
    for k in range(n if middle else n + 1):
        if isinstance(ground, DragGround):
            law = ground.law(wall.stretches[k])
        elif isinstance(ground, DryGround):
            law = ground.law(k, weight[k])
        else:
            law = ground.law(weight[k], pressed[k])
        force = ca.SX.sym(f"force_{k}")
        found.append(
            Contact(f"{what} {k}", velocities[k], force, law, float(weight[k]) or 1.0,
                    body.nominal_speed)
        )  # fmt: skip
    return found


def _limits(contacts: Sequence[Contact], *, drags: bool) -> Iterator[Output]:
    """Yield what each contact can hold at rest: nothing, for drag."""
    if not drags:
        intervals = [contact.law.stick_interval for contact in contacts]
        yield Output("limit_forward", _column(-low for low, _ in intervals), "force")
        yield Output("limit_backward", _column(high for _, high in intervals), "force")


def _ground_powers(contacts: Sequence[Contact], *, drags: bool) -> Iterator[Output]:
    power = sum((c.force * c.velocity for c in contacts), ca.SX(0))
    yield Output("drag_power", power if drags else ca.SX(0), "power")
    yield Output("friction_power", ca.SX(0) if drags else power, "power")


# -- columns -------------------------------------------------------------------------------------


def _column(entries: Iterable[Any]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *entries)


def _halves(entries: Any) -> Any:
    """Return sums of half of each entry for both of its rings, one more than entries."""
    if isinstance(entries, ca.SX):
        return (ca.vertcat(entries, 0) + ca.vertcat(0, entries)) / 2
    return (np.append(entries, 0.0) + np.append(0.0, entries)) / 2


def _along(rates: ca.SX, velocity: ca.SX, forces: ca.SX) -> ca.SX:
    """Return forces on the rings with the same work as forces along some rates."""
    return ca.jacobian(rates, velocity).T @ forces
