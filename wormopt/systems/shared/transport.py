"""The cost of transport: energy divided by weight and distance, for scenes in SI units only."""

from __future__ import annotations

from wormopt.quantities import GRAVITY


def cost_of_transport(energy: float | None, units: str) -> dict[str, float | None]:
    """The scalar, from the energy divided by mass and distance; empty in a dimensionless scene."""
    if units != "SI":
        return {}
    return {"cost_of_transport": None if energy is None else energy / GRAVITY}


def assumed(units: str, **others: str) -> dict[str, dict[str, str]]:
    """Assumptions for a trust report, with standard gravity in SI scenes; empty if none."""
    gravity = f"cost_of_transport uses weights under standard gravity, {GRAVITY} m/s2"
    found = others | ({"gravity": gravity} if units == "SI" else {})
    return {"assumptions": found} if found else {}
