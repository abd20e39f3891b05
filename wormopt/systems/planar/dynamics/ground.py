"""Contacts of points of a body with the ground of the plane and with obstacles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law
from wormopt.model.lift import lift
from wormopt.model.model import Contact, Signal
from wormopt.model.planar_friction import PlanarLaw
from wormopt.systems.planar.body.obstacles import Disc, Wall


@dataclass(frozen=True)
class Axes:
    """Ground with independent friction laws along a point's heading and across it.

    Two `Viscous` laws are linear drag, two `Coulomb` laws a box of forces. `NoSlip` across is a
    skid or a wheel, a `Spike` along is a spike, both are a skid with spikes, and two `NoSlip` laws
    are a pin.

    Parameters
    ----------
    along, across : Law, optional
        Laws; None for no resistance.

    Raises
    ------
    ArgumentError
        If a law is no friction law of a single direction.

    Examples
    --------
    >>> from wormopt.model.friction import Coulomb, NoSlip
    >>> skid = Axes(along=Coulomb(0.1, 0.1), across=NoSlip())
    >>> skid.across
    NoSlip(scale=1.0)
    """

    along: Law | None = None
    across: Law | None = None

    def __post_init__(self) -> None:
        for name in ("along", "across"):
            law = getattr(self, name)
            if law is not None and (not isinstance(law, Law) or isinstance(law, type)):
                raise ArgumentError(f"{name} must be Coulomb(1, 2) or the like, not {law!r:.60}")

    @property
    def laws(self) -> tuple[Law | None, Law | None]:
        """Along and across."""
        return self.along, self.across


Ground = Axes | PlanarLaw
"""Law of one point in the plane."""


@dataclass(frozen=True, eq=False)
class Touching:
    """Contacts of all points with the ground."""

    contacts: list[Contact]
    forces: ca.SX  # (2, points) of the ground, along the headings and to their left
    parameters: tuple[Signal, ...]

    @property
    def symbols(self) -> ca.SX:
        """Column of the forces' symbols, in the contacts' order."""
        return ca.vertcat(ca.SX(0, 1), *(contact.force for contact in self.contacts))


def ground_laws(law: Any, points: int) -> list[Ground | None]:
    """Return the law of every point, from one for all or a sequence; else raise ArgumentError."""
    laws: list[Any] = (
        [*law] if isinstance(law, Sequence) and not isinstance(law, str) else [law] * points
    )
    if len(laws) != points:
        raise ArgumentError(f"law must be one or {points}, not {len(laws)}")
    for each in laws:
        known = isinstance(each, Axes | PlanarLaw) and not isinstance(each, type)
        if each is not None and not known:
            raise ArgumentError(
                f"law must be Elliptic(1, 2, sideways=3), Axes(along, across) or the like, "
                f"not {each!r:.60}"
            )
    return laws


def touch(laws: Sequence[Ground | None], velocities: ca.SX, force: float, speed: float) -> Touching:
    """Return contacts of points with `velocities` (2, points) along and across their headings.

    `force` and `speed` are usual sizes. Values of the laws become parameters.
    """
    named = [*_named(laws)]
    lifted, parameters = lift([law for *_, law in named])
    forces, contacts = ca.SX.zeros(2, len(laws)), []
    for (name, i, rows, _), law in zip(named, lifted, strict=True):
        symbol = ca.SX.sym(f"force_{len(contacts)}", len(rows))
        forces[rows, i] = symbol
        contacts.append(Contact(name, velocities[rows, i], symbol, law, force, speed))
    return Touching(contacts, forces, parameters)


def _named(laws: Sequence[Ground | None]) -> Iterator[tuple[str, int, list[int], Any]]:
    """Yield name, point, components and law of every contact."""
    for i, law in enumerate(laws):
        if not isinstance(law, Axes):
            if law is not None:
                yield f"mass {i}", i, [0, 1], law
            continue
        for row, (word, one) in enumerate(zip(("along", "across"), law.laws, strict=True)):
            if one is not None:
                yield f"mass {i} {word}", i, [row], one


# -- obstacles -------------------------------------------------------------------------------------


def press(
    obstacles: Sequence[Wall | Disc], places: ca.SX, velocities: ca.SX, force: float, speed: float
) -> tuple[list[Contact], ca.SX]:
    """Return contacts of points with obstacles, and their forces (2, points).

    `places` and `velocities` (2, points) are in the plane.
    """
    contacts, forces = [], ca.SX.zeros(2, places.size2())
    for k, obstacle in enumerate(obstacles):
        if not isinstance(obstacle, Wall | Disc):
            raise ArgumentError(f"obstacles must be Wall or Disc, not {obstacle!r:.60}")
        for i in range(places.size2()):
            normal = obstacle.normal(places[:, i])
            aside = ca.vertcat(-normal[1], normal[0])
            pressed, rubbed = ca.SX.sym(f"pressed_{k}_{i}"), ca.SX.sym(f"rubbed_{k}_{i}")
            law = Coulomb(obstacle.friction * pressed, obstacle.friction * pressed)
            forces[:, i] += pressed * normal + rubbed * aside
            contact = Contact(
                f"mass {i} at obstacle {k}",
                ca.dot(aside, velocities[:, i]),
                rubbed,
                law,
                force,
                speed,
                gap=obstacle.gap(places[:, i]),
                normal_force=pressed,
            )
            contacts.append(contact)
    return contacts, forces
