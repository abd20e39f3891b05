"""Kind "film-flow": the flow in a wave on a film, and the field that makes the wave."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    checks,
    entry,
    facts,
    on_use,
    parts,
    scalar,
    signal,
    value,
    warnings,
    whole,
)
from wormopt.study.types import wrong_order
from wormopt.systems.film.tables import Film, Share, SharePair

with on_use():
    import numpy as np

    from wormopt.magnetics.pressure import OERSTED, gaussian_pressure, magnetic_pressure
    from wormopt.systems.film.cosine import CosineWave, square_wave_flow
    from wormopt.systems.film.lubrication import field_slope, flow, surface_velocity, velocities
    from wormopt.systems.film.next_order import (
        Corrected,
        corrected_flow,
        flow_terms,
        reach_warnings,
    )
    from wormopt.systems.film.shapes import FourierWave, Wave, flow_constant, grid
    from wormopt.systems.film.units import Fluid

_ACCEPTED = 1e-9  # accepted errors in checks, over the largest value
_GAUSS = 3  # points of quadrature across the film
_STEEPEST = 0.999  # largest amplitude that quadrature resolves

Shares = Annotated[
    tuple[Share, ...],
    Meta(min_length=1, max_length=8, description="1 to 8 numbers above 0 and below 1"),
]


class Curves(Given):
    """Amplitudes of cosine waves for comparison."""

    delta: Shares = entry(
        "amplitudes of the fields in the picture",
        quantity="1",
        default=(0.1, 0.3, 0.5, 0.7, 0.9),
    )
    range: SharePair = entry(
        "range of amplitudes of the mean-flow curve",
        quantity="1",
        default=(0.005, 0.995),
    )
    points: int = whole(2, 100000, "number of amplitudes on that curve", default=199)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("range", self.range, may_be_equal=False)


@dataclass(frozen=True)
class Numbers:
    """Dimensionless numbers of a wave."""

    c_constant: float = value("1", "*C*")
    mean_flow: float = value("1", "mean flow 1 + *C*")
    mean_flow_per_eps2: float = value(
        "1", "correction of the mean flow by the next order, over *ε*²"
    )
    d_max: float = value(
        "1", "largest (*μ* − 1)*D*/(8π); (*μ* − 1)*H*<sub>0</sub>²/(8π) is at least as large"
    )
    xi_at_d_max: float = value("rad", "phase of the largest *D*")
    delta: float = value(
        "1", "amplitude; for other waves half the difference of largest and least thickness"
    )
    tension_number: float = value("1", "*W*")
    surface_speed_max: float = value(
        "1", "largest surface speed over the wave speed; from 1 on the wave holds floats"
    )


@dataclass(frozen=True)
class InSI:
    """Numbers of a film of a fluid."""

    field_h0: float = value("magnetic_field", "least *H*<sub>0</sub> (SI)", when="film.fluid")
    field_h0_gaussian: float = value(
        "Oe", "least *H*<sub>0</sub> in Gaussian units (SI)", when="film.fluid"
    )
    field_max: float = value(
        "magnetic_field",
        "largest field at the least *H*<sub>0</sub> (SI)",
        when="film.fluid",
    )
    wave_speed: float = value("speed", "speed of the wave (SI)", when="film.fluid")
    flow_rate: float = value("flow_per_width", "mean flow per width (SI)", when="film.fluid")
    pressure_scale: float = value("stress", "pressure scale *P* (SI)", when="film.fluid")
    reynolds: float = value("1", "*Re* (SI)", when="film.fluid")


@dataclass(frozen=True)
class OverPhase:
    """The wave over its phase."""

    xi: np.ndarray = signal("rad", "xi", "phase t - x of the wave")
    height: np.ndarray = signal("1", "xi", "thickness over its mean")
    surface_velocity: np.ndarray = signal("1", "xi", "surface velocity over the speed of the wave")
    film_pressure: np.ndarray = signal("1", "xi", "film pressure minus its mean, over P")
    field_squared: np.ndarray = signal("1", "xi", "(mu - 1) H^2 / (8 pi) over P of the least field")
    field: np.ndarray | None = signal("magnetic_field", "xi", "least field H")


@dataclass(frozen=True)
class OverAmplitude:
    """Cosine waves of other amplitudes."""

    curve_delta: np.ndarray = signal("1", "curve_delta", "amplitude over mean thickness")
    curve_mean_flow: np.ndarray = signal("1", "curve_delta", "mean flow of a cosine wave")
    curve_square_wave: np.ndarray = signal(
        "1", "curve_delta", "least upper bound of the mean flow of all waves at W = 0"
    )
    curve_d_max: np.ndarray = signal("1", "curve_delta", "(mu - 1) D_max / (8 pi)")
    curve_field_h0: np.ndarray | None = signal("magnetic_field", "curve_delta", "least H0")
    field_delta: np.ndarray = signal("1", "field_delta", "amplitude of a field")
    field_curves: np.ndarray = signal(
        "1", "field_delta xi", "(mu - 1) H^2 / (8 pi) over P of the least field"
    )


class FilmFlow(Study, kind="film-flow"):
    """Compute the mean flow of a magnetic fluid film under a wave, and its field.

    The field is the least that makes the travelling wave. Flow and field are compared with those of
    cosine waves of other amplitudes. Theory: [theory-film.md](../theory-film.md#1-the-film). The
    trust report checks the equations by routes that are independent of the solution. Its `validity`
    (SI) contains *ε*, *ε Re*, *μ*<sub>r</sub> − 1 and the weight of the film over *P*; values above
    0.1 give a warning.
    """

    pictures: ClassVar = {
        "film": "mean flow over amplitude (as figure 15 of Zimmermann et al. 2007), shape, "
        "surface velocity, fields",
    }
    headline: ClassVar = (
        "c_constant", "mean_flow", "mean_flow_corrected", "mean_flow_bar", "mean_flow_per_eps2",
    )  # fmt: skip

    film: Film = entry("film and wave")
    curves: Curves = entry("cosine waves for comparison", default=Curves)
    samples: int = whole(2, 100000, "number of phases in the result", default=401)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.film.faults_in(self.units)

    @cached_property
    def wave(self) -> Wave:
        """The wave."""
        return self.film.wave(self.name)

    @cached_property
    def harmonics(self) -> FourierWave:
        """Harmonics of the wave, for checks; SceneError for too thin a film."""
        if not isinstance(self.wave, CosineWave):
            return self.wave
        delta = self.wave.delta
        harmonics = FourierWave([delta])
        try:
            _ = harmonics.nodes
        except ArgumentError as error:
            what = str(error).partition(";")[0]
            message = f"{delta!r}: {what}, which the checks need; write at most {_STEEPEST:g}"
            raise SceneError(self.name, [("film.delta", message)]) from None
        return harmonics

    @property
    def fluid(self) -> Fluid:
        """Fluid and scales, in SI scenes."""
        assert self.film.fluid
        return self.film.fluid

    # -- results -----------------------------------------------------------------------------------

    @parts(Numbers)
    def numbers(self) -> Numbers:
        wave, tension = self.wave, self.film.tension_number
        peak, h = wave.peak(tension), wave.height(grid(4096))
        half = (float(np.max(h)) - float(np.min(h))) / 2
        return Numbers(
            c_constant=wave.constant,
            mean_flow=wave.mean_flow,
            mean_flow_per_eps2=sum(flow_terms(wave)),
            d_max=peak.value,
            xi_at_d_max=peak.xi,
            delta=half if self.film.delta is None else self.film.delta,
            tension_number=tension,
            surface_speed_max=float(np.max(surface_velocity(h, wave.constant))),
        )

    @property
    def knows_eps(self) -> bool:
        """Whether depth times wave number is known."""
        return self.film.thinness is not None

    @scalar("1", "*ε* (SI, or as in the scene)", when="knows_eps")
    def eps(self) -> float:
        return self.film.thinness or 0.0

    @cached_property
    def corrected(self) -> Corrected:
        """Mean flow with the next order."""
        return corrected_flow(self.wave, self.eps)

    @scalar("1", "mean flow with the correction of the next order, *ε*²", when="knows_eps")
    def mean_flow_corrected(self) -> float:
        return self.corrected.value

    @scalar(
        "1",
        "error estimate of that flow for lubrication theory without inertia; unknown where "
        "*ε* times the highest harmonic is above 3",
        when="knows_eps",
    )
    def mean_flow_bar(self) -> float | None:
        return self.corrected.bar

    @scalar(
        "1",
        "upper bound of the mean flow of all waves of this amplitude (cosine wave)",
        when="film.delta",
    )
    def mean_flow_square_wave(self) -> Any:
        return square_wave_flow(self.film.delta)

    @parts(InSI)
    def in_si(self) -> InSI:
        wave, fluid, tension = self.wave, self.fluid, self.film.tension_number
        largest, lowest = wave.peak(tension).value, np.min(wave.field_function(grid(4096), tension))
        return InSI(
            field_h0=float(fluid.field(largest)),
            field_h0_gaussian=float(fluid.gaussian_field(largest)),
            field_max=float(fluid.field(largest - lowest)),
            wave_speed=fluid.speed,
            flow_rate=wave.mean_flow * fluid.speed * fluid.depth,
            pressure_scale=fluid.pressure,
            reynolds=fluid.reynolds,
        )

    @parts(OverPhase)
    def over_phase(self) -> OverPhase:
        wave, fluid = self.wave, self.film.fluid
        xi = np.linspace(0.0, 2 * np.pi, self.samples)
        h, squared = wave.height(xi), wave.least_field(xi, self.film.tension_number)
        return OverPhase(
            xi=xi,
            height=h,
            surface_velocity=surface_velocity(h, wave.constant),
            film_pressure=wave.pressure(xi),
            field_squared=squared,
            field=fluid and fluid.field(squared),
        )

    @parts(OverAmplitude)
    def over_amplitude(self) -> OverAmplitude:
        (least, largest), tension = self.curves.range, self.film.tension_number
        delta, fluid = np.linspace(least, largest, self.curves.points), self.film.fluid
        waves = [CosineWave(each) for each in delta]
        peaks = np.array([wave.peak(tension).value for wave in waves])
        xi = np.linspace(0.0, 2 * np.pi, self.samples)
        shapes = [CosineWave(each).least_field(xi, tension) for each in self.curves.delta]
        return OverAmplitude(
            curve_delta=delta,
            curve_mean_flow=np.array([wave.mean_flow for wave in waves]),
            curve_square_wave=square_wave_flow(delta),
            curve_d_max=peaks,
            curve_field_h0=fluid and fluid.field(peaks),
            field_delta=np.array(self.curves.delta),
            field_curves=np.array(shapes),
        )

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def equations(self) -> Iterator[Check]:
        yield from _checks(self.wave, self.harmonics, self.film.tension_number)

    @facts
    def validity(self) -> dict[str, Any]:
        return {"validity": _validity(self.fluid)} if self.film.fluid else {}

    @warnings
    def assumptions(self) -> Iterator[str]:
        yield from self.fluid.warnings() if self.film.fluid else ()
        yield from reach_warnings(self.wave, self.film.thinness)


def _checks(wave: Wave, harmonics: FourierWave, tension: float) -> Iterator[Check]:
    """Relative residuals of the laws, by routes that are independent of the solution."""
    xi = grid(2 * harmonics.nodes) + 0.1  # Phases outside the grid of the quadrature.
    h, slope, C = wave.height(xi), wave.height(xi, 1), wave.constant
    field = wave.field_function(xi, tension)
    count = np.fft.rfftfreq(len(xi), 1 / len(xi))
    by_transform = np.fft.irfft(1j * count * np.fft.rfft(field), len(xi))
    right = -field_slope(h, wave.height(xi, 3), C, tension)
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS)
    z = h * (nodes[:, None] + 1) / 2
    u, _ = velocities(z, h, slope, C)
    carried = h / 2 * (weights @ u)
    top, lift = velocities(h, h, slope, C)
    peak = wave.peak(tension)
    found = {
        "field slope (29)": _share(by_transform - right, right),
        "periodicity of the field": _share(np.mean(right), right),
        "volume flow (28)": _share(carried - flow(h, C), flow(h, C)),
        "kinematic condition (22)": _share(lift - slope * (1 - top), slope),
        "largest of D": max(0.0, float(np.max(field)) / peak.value - 1),
        "C by quadrature": abs(flow_constant(h) / C - 1),
    }
    for name, off in found.items():
        advice = f"{name} has an error of {off:.2g} of its size, where {_ACCEPTED:g} is accepted"
        yield Check(name, off, _ACCEPTED, advice)


def _share(error: Any, size: np.ndarray) -> float:
    return float(np.max(np.abs(error)) / np.max(np.abs(size)))


def _validity(fluid: Fluid) -> dict[str, float]:
    """Quantities that must be small, and the agreement of the two systems of units."""
    field = float(fluid.field(1.0))
    gaussian = gaussian_pressure(fluid.mu_r, field / OERSTED) / 10
    return {
        "eps": fluid.eps,
        "eps_reynolds": fluid.eps * fluid.reynolds,
        "mu_r_minus_1": fluid.mu_r - 1,
        "weight_over_pressure": fluid.gravity,
        "gaussian_units_difference": float(gaussian / magnetic_pressure(fluid.mu_r, field)) - 1,
    }
