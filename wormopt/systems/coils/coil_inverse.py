"""Kind "coil-inverse": currents of a row of coils for the field that a wave of a film needs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.study import (
    Given,
    array,
    check,
    entry,
    facts,
    number,
    on_use,
    positive,
    scalar,
    stage,
    warnings,
    whole,
)
from wormopt.study.types import Seed
from wormopt.systems.coils.coil_row import AlongRow

with on_use():
    import numpy as np

    from wormopt.magnetics.coils import field_by_quadrature
    from wormopt.magnetics.travelling import MovingProfile, moving_profile
    from wormopt.systems.coils.row_currents import RowFit, TravellingTarget, fit_currents
    from wormopt.systems.film import CarriedFilm, CosineWave, Fluid, carried_film

_ACCEPTED = 1e-8  # relative difference of H² by formula and by quadrature
_FINER = 4  # refinement of the check's grid, in places and in phases
_POINTS, _SAMPLES = 3, 201
_SPREAD = 1e-3  # difference of residuals above which starts count as different optima
_VIOLATION = 1e-7
_SOLVED = 1e-6  # largest residual of Newton's method of a converged film
# Residuals above which the field differs much from the wanted one, or is worse than a constant.
_POOR, _WORSE = 0.5, 1.0


class ThinFilm(Given):
    """A film of magnetic fluid."""

    depth: float = positive("length", "mean thickness")
    mu_r: float = number("1", "relative permeability", above=1, default=1.09)
    viscosity: float = positive("viscosity", "dynamic viscosity", default=0.01)
    density: float = positive("density", "density, used for warnings only", default=1100.0)
    surface_tension: float = number("surface_tension", "surface tension", least=0, default=0.03)


class Wave(Given):
    """The wanted wave of the surface."""

    delta: float = number("share", "amplitude over mean thickness", above=0, below=1)
    wavelength: float = positive("length", "wavelength, at least two pitches")
    frequency: float = positive("angular_frequency", "angular frequency of the wave")
    field: float | None = positive(
        "magnetic_field", "*H*<sub>0</sub>; optimised if left out", default=None
    )


class CurrentLimits(Given):
    """Limits of the currents, besides the ampere-turns of the coils."""

    slew: float | None = positive(
        "ampere_turn_rate",
        "largest rate of a coil's ampere-turns; unlimited if left out",
        default=None,
    )
    polarity: Literal["any", "one", "alternating"] = entry(
        "sign of the currents: any, with the period of the wave; a single sign; or a change "
        "of sign after each period",
        default="any",
    )


class CurrentSearch(Given):
    """Resolution and starting points of the search."""

    nodes: int = whole(
        8, 200, "corners of the waveform in a period, and number of phases compared", default=40
    )
    places: int = whole(1, 20, "places per pitch at which fields are compared", default=3)
    starts: int = whole(
        1, 100, "number of starts: three values of *H*<sub>0</sub>, then random ones", default=4
    )
    seed: Seed = entry("seed; equal seeds give equal starts", default=0)


class RowCurrents(AlongRow, kind="coil-inverse"):
    """Find the currents of a row of coils whose field best matches that of a film wave.

    The wanted *H*² for a cosine wave of the film is eq. 31 of Zimmermann et al. 2007
    [[1]](../references.md). Theory, and the range of fields of a row:
    [theory-coils.md](../theory-coils.md#3-currents-for-a-field). `units` must be `"SI"`.

    The resulting film is the steady film nearest to the wave under the mean field in the wave's
    frame. Newton's method finds it; it is unknown if there is none. To simulate a film under this
    field, use a scene of kind [`film-forward`](film-forward.md) beside your `results` folder with
    `field = { file = "results/coil_row_inverse", variable = "pressure_mean" }`.
    `gait_breaks` and `gait_polynomial` are the currents as a Gait (`load_gait`).

    The trust report has `solver`, `violation` (of the program), `bound_violation` (of the currents
    themselves), and `recheck` (*H*² at three places and times by quadrature, and the residual
    there). `starts` lists offset, status and residual of each start. `warnings` report currents at
    their bound, starts with different results, a residual that grows on the finer grid, and effects
    that lubrication neglects. A large residual is a valid result, not a failure. The exit code is 3
    if no start is solved.
    """

    pictures: ClassVar = {"row_currents": "*H*² over the phase of the wave, and the currents"}
    headline: ClassVar = (
        "field_residual", "field_residual_mean", "field_residual_program", "ripple", "H0",
    )  # fmt: skip

    film: ThinFilm = entry("the fluid")
    wave: Wave = entry("wanted wave of its surface")
    limits: CurrentLimits = entry("limits of the currents", default=CurrentLimits)
    search: CurrentSearch = entry("resolution and starting points", default=CurrentSearch)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        if self.wave.wavelength < 2 * self.coils.pitch:
            yield (
                "wave.wavelength",
                f"{self.wave.wavelength:g} is below two pitches; coils {self.coils.pitch:g} apart "
                f"cannot distinguish this wave from a longer one; write at least "
                f"{2 * self.coils.pitch:g}",
            )

    # -- the field that the wave needs, and the currents -------------------------------------------

    @cached_property
    def fluid(self) -> Fluid:
        """The film, in the units of its equations."""
        film = self.film
        return Fluid(
            mu_r=film.mu_r, viscosity=film.viscosity, density=film.density,
            surface_tension=film.surface_tension, depth=film.depth,
            wavelength=self.wave.wavelength, frequency=self.wave.frequency,
        )  # fmt: skip

    @cached_property
    def cosine(self) -> CosineWave:
        """The wave."""
        return CosineWave(self.wave.delta)

    @cached_property
    def square_unit(self) -> float:
        """H² with the pressure P, in A²/m²."""
        return float(self.fluid.field(1.0)) ** 2

    @cached_property
    def target(self) -> TravellingTarget:
        """The field that the wave needs; SceneError if the given field is below the least."""
        unit, tension, field = self.square_unit, self.fluid.tension, self.wave.field
        try:
            return TravellingTarget(
                lambda xi: unit * np.asarray(self.cosine.field_function(xi, tension)),
                unit * self.cosine.peak(tension).value,
                self.wave.wavelength,
                2 * math.pi / self.wave.frequency,
                None if field is None else field**2,
            )
        except ArgumentError as error:
            text = f"{error}; write at least that, or leave it out"
            raise SceneError(self.name, [("wave.field", text)]) from None

    @stage
    def fit(self) -> RowFit:
        search, limits = self.search, self.limits
        return fit_currents(
            self.coils.row, self.target, self.interior(search.places), self.line.height,
            nodes=search.nodes, slew=limits.slew, polarity=limits.polarity, starts=search.starts,
            seed=search.seed, report=self.report,
        )  # fmt: skip

    @stage
    def profile(self) -> MovingProfile:
        """The resulting field, on a finer grid."""
        return moving_profile(
            self.coils.row, self.fit.course, self.interior(_FINER * self.search.places),
            self.line.height, wavelength=self.target.wavelength, period=self.target.period,
            phases=_FINER * self.search.nodes,
        )  # fmt: skip

    @array("magnetic_field_squared", "phase", "wanted H²")
    def square_target(self) -> np.ndarray:
        return self.fit.square - self.target.function(self.profile.xi)

    @array("1", "phase", "(mu - 1) H² / (8 pi) over P")
    def pressure_mean(self) -> np.ndarray:
        return self.profile.mean / self.square_unit

    @array("time", "time", "time")
    def time(self) -> np.ndarray:
        return np.linspace(0.0, self.fit.course.period, _SAMPLES)

    @array("ampere_turns", "coil time", "ampere-turns")
    def current(self) -> np.ndarray:
        return self.fit.course(self.time)

    @array("time", "break", "currents as a Gait: breaks")
    def gait_breaks(self) -> np.ndarray:
        return self.fit.course.breaks

    @array("ampere_turns", "piece coil power", "currents as a Gait: polynomial")
    def gait_polynomial(self) -> np.ndarray:
        return self.fit.course.polynomial

    @scalar(
        "share",
        "root mean square of the error of *H*² over that of *D*, on a grid four times finer in "
        "place and phase",
    )
    def field_residual(self) -> float:
        return self.profile.residual(self.square_target)

    @scalar("share", "`field_residual` of the mean over the places")
    def field_residual_mean(self) -> float:
        off = self.profile.mean - self.square_target
        return float(np.sqrt(np.mean(off**2)) / np.std(self.square_target))

    @scalar("share", "`field_residual` at the points of the program")
    def field_residual_program(self) -> float:
        return self.fit.residual

    @scalar("magnetic_field", "*H*<sub>0</sub>")
    def H0(self) -> float:
        return math.sqrt(self.fit.square)

    @scalar("magnetic_field", "√*D*<sub>max</sub>")
    def H0_least(self) -> float:
        return math.sqrt(self.target.least_square)

    @scalar("magnetic_field", "largest *H* on the line")
    def field_max(self) -> float:
        return math.sqrt(float(self.profile.square.max()))

    @scalar("ampere_turns", "largest current of a coil")
    def currents_max(self) -> float:
        return float(np.max(np.abs(self.fit.nodes)))

    @scalar("share", "largest current over its bound")
    def currents_share(self) -> float:
        return self.currents_max / self.coils.ampere_turns

    @scalar("ampere_turn_rate", "largest slope of a current")
    def slew_max(self) -> float:
        return float(np.max(np.abs(self.fit.course.polynomial[:, :, 1])))

    # -- the wave ----------------------------------------------------------------------------------

    @scalar("length", "wavelength of the wave")
    def wavelength(self) -> float:
        return self.target.wavelength

    @scalar("time", "period of the wave")
    def period(self) -> float:
        return self.target.period

    @scalar("speed", "speed of the wave")
    def wave_speed(self) -> float:
        return self.wavelength / self.period

    @scalar("stress", "*P* of eq. 25 of Zimmermann et al.")
    def pressure_unit(self) -> float:
        return self.fluid.pressure

    @scalar("1", "*W* of eq. 25")
    def tension_number(self) -> float:
        return self.fluid.tension

    @scalar("1", "*ε* of eq. 25")
    def eps(self) -> float:
        return self.fluid.eps

    @scalar("1", "mean flow of the wave")
    def mean_flow(self) -> float:
        return self.cosine.mean_flow

    # -- the resulting film ------------------------------------------------------------------------

    @stage
    def resulting_film(self) -> CarriedFilm | None:
        return carried_film(self.cosine, self.pressure_mean, self.fluid.tension)

    @property
    def steady_film(self) -> CarriedFilm | None:
        """The resulting film; None if there is none, or it is not converged."""
        film = self.resulting_film
        return film if film and film.residual <= _SOLVED else None

    @scalar("share", "largest difference of the resulting film to the wave")
    def film_distance(self) -> float | None:
        return self.steady_film and self.steady_film.distance

    @scalar("share", "mean flow of the resulting film")
    def film_mean_flow(self) -> float | None:
        return self.steady_film and self.steady_film.mean_flow

    @scalar(
        "share", "largest growth rate of small deviations of that film, in units of the frequency"
    )
    def film_growth_rate(self) -> float | None:
        return self.steady_film and self.steady_film.growth

    @array("rad", "film_phase", "phase of the wave")
    def film_phase(self) -> np.ndarray | None:
        return self.steady_film and self.steady_film.xi

    @array("1", "film_phase", "thickness of the resulting film, over its mean")
    def film_thickness(self) -> np.ndarray | None:
        return self.steady_film and self.steady_film.thickness

    # -- the trust report --------------------------------------------------------------------------

    @stage
    def second_route(self) -> dict[str, Any]:
        """H² at a few places and times by quadrature of the Biot-Savart law."""
        share = (np.arange(_POINTS) * 0.6180339887 + 0.1) % 1.0
        row, places, z = self.coils.row, self.profile.places, self.line.height
        x = places[0] + (places[-1] - places[0]) * share
        t = self.fit.course.period * share[::-1]
        currents = self.fit.course(t)
        second = np.sum(field_by_quadrature(row, x, z, currents) ** 2, axis=0)
        formula = np.einsum("cmk,km->cm", row.influence(x, z), currents)
        error = float(np.max(np.abs(np.sum(formula**2, axis=0) - second)))
        phase = 2 * np.pi * (t / self.target.period - x / self.target.wavelength)
        wanted = self.fit.square - self.target.function(phase)
        off = np.sqrt(np.mean((second - wanted) ** 2)) / np.std(self.square_target)
        largest = float(self.profile.square.max())
        return {
            "error": error / largest if largest else 0.0,
            "accepted": _ACCEPTED,
            "points": _POINTS,
            "field_residual_there": float(off),
        }

    @check(_ACCEPTED, "H² by quadrature differs by {value:.2g} of the largest")
    def field_by_quadrature(self) -> float:
        return self.second_route["error"]

    @check(_VIOLATION, "currents exceed their bounds by {value:.2g} of these")
    def bounds_of_the_currents(self) -> float:
        """Largest violation of bounds by the waveform itself, over the bound."""
        ends = self.fit.course(self.fit.course.breaks[:-1])
        excess = np.max(np.abs(ends)) / self.coils.ampere_turns - 1
        if self.limits.slew is not None:
            excess = max(excess, self.slew_max / self.limits.slew - 1)
        if self.limits.polarity == "one":
            excess = max(excess, -ends.min() / self.coils.ampere_turns)
        return max(float(excess), 0.0)

    @facts
    def solver(self) -> dict[str, Any]:
        solution, film = self.fit.solution, self.resulting_film
        return {
            "solver": {
                name: getattr(solution, name) for name in ("status", "success", "iterations")
            },
            "violation": solution.violation,
            "bound_violation": self.bounds_of_the_currents,
            "recheck": self.second_route,
            "film_residual": film.residual if film else None,
            "film_accepted": _SOLVED,
            "starts": list(self.fit.starts),
        }

    @warnings
    def limits_of_the_currents(self) -> Iterator[str]:
        limit, program = self.coils.ampere_turns, self.fit.residual
        yield from self.fluid.warnings()
        yield from self.coils.too_hot(self.currents_max)
        if self.currents_max > limit * (1 - 1e-6):
            yield (
                f"currents are at the limit of {limit:g} ampere-turns of the coils; a higher "
                "limit, or a wave that needs less field, reduces the residual"
            )
        tried = [start["residual"] for start in self.fit.starts]
        solved = [residual for residual in tried if isinstance(residual, float)]
        if max(solved) > min(solved) * (1 + _SPREAD):
            yield f"starts ended at residuals from {min(solved):.4g} to {max(solved):.4g}"
        residual = self.field_residual
        remedy = "write more ampere-turns, a smaller wave or other coils to reduce it"
        if not residual <= _POOR:
            poor = "far from the wanted one" if residual < _WORSE else "worse than a constant field"
            yield f"the field is {poor}: field_residual is {residual:.3g}; {remedy}"
        if residual > 1.1 * program:
            yield (
                f"on a finer grid the residual is {residual:.4g} instead of {program:.4g}; write "
                "more search.nodes or search.places"
            )

    @warnings
    def limits_of_the_film(self) -> Iterator[str]:
        film, found = self.steady_film, self.resulting_film
        if found is None:
            yield "no steady film was found near the wave under the resulting field"
        elif film is None:
            yield (
                f"the resulting film is unknown: Newton's method left a residual of "
                f"{found.residual:.2g}, but {_SOLVED:g} is accepted"
            )
        else:
            if film.growth > 0:
                yield (
                    f"the resulting film is unstable: deviations grow at the rate {film.growth:.3g}"
                )
            if film.distance > 0.5 * self.wave.delta:
                yield (
                    f"the resulting film differs from the wave by {film.distance:.3g} of the mean "
                    f"thickness; the wave's amplitude is {self.wave.delta:g}"
                )
            yield (
                "the film is computed with the mean field in the wave's frame; its ripple is "
                "neglected"
            )
