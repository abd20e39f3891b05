"""Friction laws under single masses, built from scenes."""

from __future__ import annotations

from wormopt.model.friction import Coulomb, NoSlip, Spike, Viscous
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic
from wormopt.systems.planar.dynamics.ground import Axes, Ground
from wormopt.systems.planar.scenes.ground import (
    BoxGround,
    EllipticGround,
    MassGround,
    PinGround,
    SkidGround,
    SpikedSkidGround,
    SpikeGround,
    UnitGround,
    ViscousGround,
)


def ground_of(table: MassGround) -> Ground | None:
    """Return the law of one mass, or None if nothing resists."""
    match table:
        case EllipticGround() | UnitGround() | BoxGround():
            ahead, back = table.forward, table.backward or table.forward
            aside = table.sideways or ahead
            if isinstance(table, BoxGround):
                return Axes(Coulomb(ahead, back), Coulomb(aside, aside))
            # with equal resistance in all directions both laws agree
            unit = isinstance(table, UnitGround) and not ahead == back == aside
            return (AnisotropicCoulomb if unit else Elliptic)(ahead, back, aside)
        case ViscousGround():
            return Axes(Viscous(table.along), Viscous(table.across))
        case SkidGround():
            return Axes(_dry(table.along), NoSlip())
        case SpikeGround():
            return Axes(Spike(), _dry(table.across))
        case SpikedSkidGround():
            return Axes(Spike(), NoSlip())
        case PinGround():
            return Axes(NoSlip(), NoSlip())
    return None


def _dry(force: float) -> Coulomb | None:
    return Coulomb(force, force) if force else None
