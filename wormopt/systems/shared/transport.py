"""The cost of transport: energy by weight and distance. Only scenes in SI units know a weight."""

from __future__ import annotations

from wormopt.quantities import GRAVITY


def cost_of_transport(energy: float | None, units: str) -> dict[str, float | None]:
    """The scalar, from the energy by mass and distance; nothing in a dimensionless scene."""
    if units != "SI":
        return {}
    return {"cost_of_transport": None if energy is None else energy / GRAVITY}


def assumed(units: str, **others: str) -> dict[str, dict[str, str]]:
    """Assumptions for a trust report, that of gravity among them; nothing where there are none."""
    gravity = f"cost_of_transport takes weights under standard gravity, {GRAVITY} m/s2"
    found = others | ({"gravity": gravity} if units == "SI" else {})
    return {"assumptions": found} if found else {}
