"""Kind "coil-pressure": surface and pressure of a magnetic fluid at rest at a coil."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import ROUND_FLOOR, Decimal, localcontext
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SolveError, interruptible
from wormopt.result import Check
from wormopt.study import (
    Given,
    array,
    attributes,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    warnings,
    whole,
)
from wormopt.systems.coils.tables import MagneticFluid
from wormopt.systems.shared.studies import SIStudy, refused_at, wrong_winding

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.magnetics.hydrostatics import Fluid, Placed, balance
    from wormopt.magnetics.material import MU0
    from wormopt.magnetics.winding import Coil
    from wormopt.systems.coils.profile import (
        Profile,
        Rested,
        Settled,
        Stop,
        field_of_pressure,
        settle,
    )

_ACCEPTED = {"defect": 1e-4, "volume_error": 1e-9, "force_imbalance": 1e-6, "field_error": 1e-7}
_DEMAGNETISED = 0.1
_STRONG = 10.0  # tesla; above all but the largest laboratory magnets
# The error of the field's quadrature is exp(-2 _DIGITS) of it at the nearest point.
_DIGITS = 10.0
# Share of the gap under a coil above that may be filled; the field is resolved up to it.
_FILLED = 0.75
_UNRESOLVED = 1e-3
# Number of points along the bottom, up the fluid, and of the map around coil and fluid.
_ALONG, _DEEP, _WIDE, _HIGH = 401, 13, 97, 61


class Tank(Given):
    """The tank, a long trough across the computed plane, and its filling."""

    thickness: float = positive("length", "thickness of the layer without field")
    width: float = positive("length", "width of the tank; the coil is in its middle")
    walls: Literal["upright", "pinned"] = entry(
        "condition at the walls: a right angle, or the height without field", default="upright"
    )


class CoilOfTank(Given):
    """The coil, without iron."""

    ampere_turns: float = number("current", "current times turns", least=0, default=3000.0)
    inner_radius: float = positive("length", "inner radius of the winding", default=5e-3)
    outer_radius: float = positive("length", "outer radius of the winding", default=15e-3)
    length: float = positive("length", "length of the winding", default=20e-3)
    distance: float = positive(
        "length",
        "distance from the bottom of the layer to the nearest point of the coil; above "
        "`layer.thickness` for a coil above",
        default=2e-3,
    )
    side: Literal["below", "above"] = entry("side of the layer with the coil", default="below")
    axis: Literal["vertical", "along"] = entry(
        "direction of the coil's axis: up, or along the width of the tank", default="vertical"
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_winding(self.inner_radius, self.outer_radius)


class Resolution(Given):
    """Resolution of the surface."""

    tolerance: float = number(
        "share",
        "largest of the polynomial's last coefficients, over the thickness",
        least=1e-10,
        most=0.001,
        default=1e-7,
    )
    degree: int = whole(64, 512, "largest degree of the polynomial", default=256)


@dataclass(frozen=True)
class InductionMap:
    """Induction around coil and fluid; not a number in the winding."""

    map_x: np.ndarray = signal("length", "map_x", "position along the bottom")
    map_z: np.ndarray = signal("length", "map_z", "height")
    induction_x: np.ndarray = signal("induction", "map_z map_x", "induction along x")
    induction_z: np.ndarray = signal("induction", "map_z map_x", "induction along z")


class CoilPressure(SIStudy, kind="coil-pressure"):
    """Compute the surface and pressure of a magnetic fluid layer at an excited coil.

    The layer rests in a tank over or under one coil. The scene computes the shape of its surface,
    the pressure on the bottom and inside, and the field. The current is raised from 0. If no
    surface rests at the full current, the result states the current at which rest ends (exit
    code 3). Theory and assumptions: [theory-hydrostatics.md](../theory-hydrostatics.md). Only
    `units = "SI"`.

    The trust report has `degree` and `tail` (last coefficients), and `defect` (error of the balance
    between the points, over the thickness). It has `volume_error`, `force_imbalance` (of the fluid,
    over its weight), `field_error`, and the `accepted` values of these. It also has `growth_rate`
    (of the slowest deviation; must be below 0), `demagnetisation`, and `warnings`.
    """

    pictures: ClassVar = {
        "coil_pressure": "figure 25 of Zimmermann et al.; no induction in the winding",
    }

    fluid: MagneticFluid = entry("the fluid")
    layer: Tank = entry("the tank and its layer")
    coil: CoilOfTank = entry("the coil", default=CoilOfTank)
    surface: Resolution = entry("resolution of the surface", default=Resolution)
    gravity: float = positive("acceleration", "acceleration of gravity", default=9.80665)
    stated_pressure: float | None = positive(
        "stress",
        "stated or measured change of pressure for comparison; none if left out",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        coil, layer = self.coil, self.layer
        if coil.side == "above" and coil.distance <= layer.thickness:
            yield (
                "coil.distance",
                f"the coil lies inside the fluid, {coil.distance:g} m above the bottom of a layer "
                f"of {layer.thickness:g} m; write more than layer.thickness",
            )

    # -- the surface -------------------------------------------------------------------------------

    @cached_property
    def liquid(self) -> Fluid:
        """The fluid as the formulas take it."""
        return self.fluid.under(self.gravity)

    @cached_property
    def placed_coil(self) -> Placed:
        """The coil and its place; SceneError if the coil is impossible."""
        given = self.coil
        with refused_at(self, "coil"):
            coil = Coil(given.inner_radius, given.outer_radius, given.length)
        return Placed(coil, given.axis, given.side, given.distance)

    @property
    def gap(self) -> float:
        """Distance of the flat surface to a coil above; infinite over a coil, in m."""
        above = self.coil.side == "above"
        return self.coil.distance - self.layer.thickness if above else math.inf

    @property
    def ceiling(self) -> float:
        """Height up to which the field is resolved, in m; infinite over a coil."""
        return self.layer.thickness + _FILLED * self.gap

    @cached_property
    def profile(self) -> Profile:
        """The surface, with the current as its load."""
        x, h, slope, bend, level, load = (ca.SX.sym(name) for name in "x h slope bend P I".split())
        clearance = min(self.coil.distance, (1 - _FILLED) * self.gap)
        Hx, Hz = self.placed_coil.field(x, h, self.placed_coil.coil.nodes(clearance, _DIGITS))
        current, half = self.coil.ampere_turns * load, self.layer.width / 2
        rest = balance(self.liquid, (current * Hx, current * Hz), h, slope, bend, level)
        return Profile(
            x, h, slope, bend, level, load, rest,
            ends=(-half, half), mean=self.layer.thickness, walls=self.layer.walls,
        )  # fmt: skip

    @stage
    def settled(self) -> Settled:
        with interruptible():
            return settle(
                self.profile, tolerance=self.surface.tolerance, degree=self.surface.degree,
                floor=0.0, ceiling=self.ceiling, report=self.report,
            )  # fmt: skip

    @cached_property
    def rested(self) -> Rested:
        """The fluid at rest, at the full current or the last one."""
        current = self.coil.ampere_turns * self.settled.load
        return Rested(self.liquid, self.placed_coil, self.settled, current)

    def unsolved(self) -> SolveError | None:
        settled = self.settled
        if settled.stop is not None:
            return self.moving(settled.stop)
        if settled.resolved:
            return None
        return SolveError(
            f"a polynomial of degree {settled.equations.n} does not resolve the surface: its last "
            f"coefficients are {settled.equations.tail(settled.y):.2g} of the thickness",
            "write a larger surface.degree or surface.tolerance, or a smaller layer.width",
            code="unresolved",
        )

    def moving(self, stop: Stop) -> SolveError:
        """Return the error of a surface that does not rest at the full current."""
        current = stop.load * self.coil.ampere_turns
        unsure = not stop.uncertainty <= _UNRESOLVED * stop.load
        at = f"{'about ' if unsure else ''}{current:.{3 if unsure else 6}g} ampere-turns"
        below = "write usual values of fluid and layer"
        if current > 0:
            below = f"write coil.ampere_turns below {_rounded_down(current)}"
        steep = float(np.abs(self.rested.surface(np.linspace(*self.profile.ends, 801), 1)).max())
        words = {
            "fold": (
                f"no surface near the layer rests above {at}, where the branch folds: the "
                "field's pull grows faster with height than weight and surface tension do",
                f"{below}, or move the coil away",
            ),
            "unstable": (
                f"the surface becomes unstable at {at} and moves sideways",
                f"{below}, or move the coil away",
            ),
            "floor": (
                f"the layer runs dry at {at}, at x = {stop.x:.3g} m: the coil draws the fluid off",
                f"{below}, or a larger layer.thickness",
            ),
            "ceiling": (
                f"at {at} the fluid rises to {self.ceiling:.3g} m at x = {stop.x:.3g} m, three "
                "quarters of the gap to the coil, and is about to touch it",
                f"{below}, or a larger coil.distance",
            ),
            "lost": (
                f"the surface cannot be continued beyond {at}; its largest slope is {steep:.2g} "
                "there, and an overhanging surface has no height over x",
                f"{below}, or raise surface.degree",
            ),
        }
        reason, suggestion = words[stop.why]
        return SolveError(reason, suggestion, code=stop.why)

    # -- along the bottom --------------------------------------------------------------------------

    @array("length", "x", "position along the bottom")
    def x(self) -> np.ndarray:
        return np.linspace(*self.profile.ends, _ALONG)

    @array("length", "x", "height of the surface", name="surface")
    def height(self) -> np.ndarray:
        return self.rested.surface(self.x)

    @array("stress", "x", "pressure on the bottom")
    def pressure(self) -> np.ndarray:
        return self.rested.pressure(self.x, np.zeros_like(self.x))

    @array("magnetic_field", "x", "H at the bottom")
    def field_bottom(self) -> np.ndarray:
        return np.hypot(*self.rested.field(self.x, np.zeros_like(self.x)))

    @array("magnetic_field", "x", "H at the surface")
    def field_surface(self) -> np.ndarray:
        return np.hypot(*self.rested.field(self.x, self.height))

    @array("current", "branch", "current of the branch")
    def branch_current(self) -> np.ndarray:
        return self.settled.path[:, 0] * self.coil.ampere_turns

    @array("length", "branch", "highest point of the surface")
    def branch_highest(self) -> np.ndarray:
        return self.settled.path[:, 2]

    @array("length", "branch", "lowest point of the surface")
    def branch_lowest(self) -> np.ndarray:
        return self.settled.path[:, 1]

    # -- inside and around -------------------------------------------------------------------------

    @array("share", "share", "height over that of the surface")
    def share(self) -> np.ndarray:
        return np.linspace(0, 1, _DEEP)

    @array("length", "inside_x", "position along the bottom")
    def inside_x(self) -> np.ndarray:
        return self.x[:: _ALONG // 100]

    @array("length", "share inside_x", "height")
    def inside_z(self) -> np.ndarray:
        return self.share[:, None] * self.rested.surface(self.inside_x)

    @array("stress", "share inside_x", "pressure in the fluid")
    def inside_pressure(self) -> np.ndarray:
        return self.rested.pressure(
            np.broadcast_to(self.inside_x, self.inside_z.shape), self.inside_z
        )

    @parts(InductionMap)
    def around(self) -> InductionMap:
        return induction_map(self.rested, self.x)

    @attributes
    def winding(self) -> dict[str, Any]:
        """Section of the winding in the plane."""
        return {"winding": self.placed_coil.section}

    # -- numbers -----------------------------------------------------------------------------------

    @scalar("stress", "highest pressure on the bottom", headline=True)
    def pressure_max(self) -> float:
        return float(np.max(self.pressure))

    @scalar("stress", "`pressure_max` less `pressure_without_field`", headline=True)
    def pressure_change_max(self) -> float:
        return self.pressure_max - self.pressure_without_field

    @scalar("stress", "pressure on the bottom without field", headline=True)
    def pressure_without_field(self) -> float:
        return self.liquid.weight * self.layer.thickness

    @scalar("length", "highest point, relative to the layer without field", headline=True)
    def surface_rise_max(self) -> float:
        return float(np.max(self.height)) - self.layer.thickness

    @scalar("length", "lowest point, relative to the layer without field", headline=True)
    def surface_drop_max(self) -> float:
        return self.layer.thickness - float(np.min(self.height))

    @scalar("1", "largest \\|*h*′\\|")
    def slope_max(self) -> float:
        return float(np.max(np.abs(self.rested.surface(self.x, 1))))

    @scalar("magnetic_field", "largest *H* at the bottom")
    def field_bottom_max(self) -> float:
        return float(np.max(self.field_bottom))

    @scalar("magnetic_field", "largest *H* at the surface")
    def field_surface_max(self) -> float:
        return float(np.max(self.field_surface))

    @scalar("induction", "largest μ<sub>0</sub>(*H* + *M*) at the bottom")
    def induction_bottom_max(self) -> float:
        ratio = np.asarray(self.liquid.magnetisation.ratio(self.field_bottom**2))
        return float(np.max(MU0 * (1 + ratio) * self.field_bottom))

    @scalar(
        "force_per_length", "upward force of the field on the fluid, per depth of the trough"
    )  # fmt: skip
    def magnetic_force(self) -> float:
        return self.rested.force

    @scalar("length", "√(γ/ρ*g*)")
    def capillary_length(self) -> float:
        return self.liquid.capillary_length

    @scalar("share", "relative difference of the volume by quadrature to the layer's")
    def volume_error(self) -> float:
        return self.errors["volume_error"]

    @scalar("share", "estimate of the neglected effect; a warning above 0.1")
    def demagnetisation(self) -> float:
        return self.rested.demagnetisation

    @scalar("current", "ampere-turns at which the shown surface rests")
    def ampere_turns(self) -> float:
        return self.rested.current

    @scalar("stress", "`stated_pressure` of the scene", name="stated_pressure")
    def stated(self) -> float | None:
        return self.stated_pressure

    @scalar("share", "`pressure_change_max` over `stated_pressure`", when="stated_pressure")
    def pressure_over_stated(self) -> float:
        assert self.stated_pressure
        return self.pressure_change_max / self.stated_pressure

    @scalar("magnetic_field", "field with this pressure in the fluid", when="stated_pressure")
    def field_for_stated(self) -> float:
        assert self.stated_pressure
        return field_of_pressure(self.liquid, self.stated_pressure)

    @scalar("induction", "μ<sub>0</sub> times this field", when="stated_pressure")
    def induction_for_stated(self) -> float:
        return MU0 * self.field_for_stated

    # -- the trust report --------------------------------------------------------------------------

    @stage
    def errors(self) -> dict[str, float]:
        """Errors of the balance and of the field, by name."""
        equations, rested = self.settled.equations, self.rested
        return {
            "defect": equations.defect(self.settled.y, self.settled.load),
            "volume_error": rested.volume_error,
            "force_imbalance": rested.force_imbalance,
            "field_error": rested.field_error,
        }

    @cached_property
    def growth_rate(self) -> float:
        """Growth rate of the slowest deviation."""
        rates = self.settled.equations.rates_of_growth(self.settled.y, self.settled.load)
        return float(rates[0].real)

    @checks
    def balances(self) -> Iterator[Check]:
        for key, accepted in _ACCEPTED.items():
            name, found = key.replace("_", " "), self.errors[key]
            yield Check(name, found, accepted, f"{name} is {found:.2g}; {accepted:g} is accepted")
        growth = self.growth_rate
        yield Check("growth rate", growth, 0.0, "the surface is not stable", passed=growth < 0)

    @facts
    def quality(self) -> dict[str, Any]:
        equations = self.settled.equations
        return self.errors | {
            "degree": equations.n,
            "tail": equations.tail(self.settled.y),
            "growth_rate": self.growth_rate,
            "accepted": _ACCEPTED,
            "demagnetisation": self.demagnetisation,
        }

    @warnings
    def assumptions(self) -> Iterator[str]:
        if self.demagnetisation > _DEMAGNETISED:
            yield (
                f"the field of the coil is computed as without fluid; by the estimate of a flat "
                f"layer the fluid reduces its pull on the surface by up to "
                f"{self.demagnetisation:.0%}"
            )
        if self.stated_pressure and self.induction_for_stated > _STRONG:
            yield (
                f"stated_pressure = {self.stated_pressure:g} Pa would need a field of "
                f"{self.induction_for_stated:.3g} T in this fluid, far above that of any coil; "
                "check its unit"
            )


def induction_map(rested: Rested, along: np.ndarray) -> InductionMap:
    """Return the induction on a grid around coil and fluid, as wide as `along`."""
    placed, coil = rested.placed, rested.placed.coil
    size = coil.length / 2 if placed.axis == "vertical" else coil.outer
    top = float(np.max(rested.surface(along)))
    ends = (placed.middle - 1.2 * size, placed.middle + 1.2 * size)
    x = np.linspace(along[0], along[-1], _WIDE)
    z = np.linspace(min(0.0, ends[0]), max(1.5 * top, ends[1]), _HIGH)
    X, Z = np.meshgrid(x, z)
    free = placed.clearance(X, Z) > 1e-3 * coil.outer
    B = np.full((2, *X.shape), np.nan)
    H = np.array(rested.field(X[free], Z[free]))
    wet = (Z[free] >= 0) & (Z[free] <= rested.surface(X[free]))
    ratio = np.asarray(rested.fluid.magnetisation.ratio(np.sum(H**2, axis=0)))
    B[:, free] = MU0 * (1 + wet * ratio) * H
    return InductionMap(x, z, B[0], B[1])


def _rounded_down(number: float) -> str:
    """Return a number >= 0 as text of three digits, rounded down."""
    with localcontext(rounding=ROUND_FLOOR):
        return f"{float(f'{Decimal(number):.3g}'):g}"
