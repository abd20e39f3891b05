"""Run scenes of kind ``film-flow``: the flow in a wave, and the field that makes the wave."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError, SceneError
from wormopt.magnetics.pressure import OERSTED, gaussian_pressure, magnetic_pressure
from wormopt.progress import Report
from wormopt.result import Check, Result, Unchecked, left_out
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.film.cosine import CosineWave, square_wave_flow
from wormopt.systems.film.lubrication import field_slope, flow, surface_velocity, velocities
from wormopt.systems.film.next_order import REACH, corrected_flow, flow_terms, within_reach
from wormopt.systems.film.scenes.film import FilmFlowScene, FilmTable
from wormopt.systems.film.shapes import FourierWave, Wave, flow_constant, grid
from wormopt.systems.film.units import Fluid

# Checks are accepted up to this share of the largest value.
_ACCEPTED = 1e-9
_GAUSS = 3
# Largest amplitude that quadrature resolves.
_STEEPEST = 0.999


def run(scene: Scene[FilmFlowScene], report: Report) -> Result:
    """Compute mean flow and field of a wave, and of cosine waves of other amplitudes.

    The result is "failed" where volume is not conserved, or the field does not hold the shape.
    """
    table, begin = scene.table, time.perf_counter()
    report("evaluating", None)
    wave, fluid = wave_of(scene, table.film), fluid_of(table.film)
    harmonics = _harmonics(scene, wave)
    tension = fluid.tension if fluid else table.film.tension or 0.0
    facts = {"validity": _validity(fluid)} if fluid else {}
    return conclude(
        scene,
        _scalars(table.film, wave, tension, fluid),
        _signals(table, wave, tension, fluid) | _curves(table, tension, fluid),
        checks=_checks(wave, harmonics, tension),
        facts=facts,
        warnings=[*(fluid.warnings() if fluid else ()), *reach_warnings(wave, eps_of(table.film))],
        timings={"evaluate": time.perf_counter() - begin},
    )


def wave_of(scene: Scene[Any], table: FilmTable) -> Wave:
    """Make the wave of a scene; raises SceneError if its thickness is not positive everywhere."""
    if table.delta is not None:
        return CosineWave(table.delta)
    key = "film.cosines" if table.cosines else "film.sines"
    try:
        wave = FourierWave(table.cosines or (), table.sines or ())
        _ = wave.nodes  # refuses waves that no grid resolves
    except ArgumentError as error:
        raise SceneError(scene.name, [(key, str(error))]) from None
    return wave


def _harmonics(scene: Scene[FilmFlowScene], wave: Wave) -> FourierWave:
    """Harmonics of the wave, used for checks; raises SceneError for too thin a film."""
    if not isinstance(wave, CosineWave):
        return wave
    harmonics = FourierWave([wave.delta])
    try:
        _ = harmonics.nodes
    except ArgumentError as error:
        what = str(error).partition(";")[0]
        message = f"{wave.delta!r}: {what}, which the checks need; write at most {_STEEPEST:g}"
        raise SceneError(scene.name, [("film.delta", message)]) from None
    return harmonics


def fluid_of(table: FilmTable) -> Fluid | None:
    """Make the fluid of a scene, None for a scene without units."""
    given = table.fluid
    if given is None:
        return None
    return Fluid(**{name: getattr(given, name) for name in given.__struct_fields__})


def eps_of(table: FilmTable) -> float | None:
    """Depth times wave number, if the scene determines it."""
    fluid = fluid_of(table)
    return fluid.eps if fluid else table.eps


def least_field(wave: Wave, xi: np.ndarray, tension: float) -> np.ndarray:
    """Least (mu - 1) H² / (8 pi) over P that makes the wave, at phases (n,)."""
    return np.maximum(wave.peak(tension).value - wave.field_function(xi, tension), 0.0)


def reach_warnings(wave: Wave, eps: float | None) -> Iterator[str]:
    """Warn where the next order in eps does not estimate the error."""
    if eps is None:
        return
    if within_reach(wave, eps):
        bar, flow = corrected_flow(wave, eps).bar, abs(wave.mean_flow)
        if bar is not None and bar > flow:
            yield left_out(
                bar / flow if flow else math.inf,
                f"eps = {eps:.3g}: lubrication theory may have an error of {bar:.2g} in a mean "
                f"flow of {flow:.2g}",
            )
    else:
        yield Unchecked(
            f"eps = {eps:.3g} times the highest harmonic is above {REACH:g}: the error of "
            "lubrication theory is unknown"
        )


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


def _scalars(film: FilmTable, wave: Wave, tension: float, fluid: Fluid | None) -> dict[str, Any]:
    peak = wave.peak(tension)
    h = wave.height(grid(4096))
    half = (float(np.max(h)) - float(np.min(h))) / 2 if film.delta is None else film.delta
    eps = eps_of(film)
    found = {
        "delta": half,
        "tension_number": tension,
        "c_constant": wave.constant,
        "mean_flow": wave.mean_flow,
        "d_max": peak.value,
        "xi_at_d_max": peak.xi,
        "surface_speed_max": float(np.max(surface_velocity(h, wave.constant))),
    }
    found["mean_flow_per_eps2"] = sum(flow_terms(wave))
    if eps is not None:
        corrected = corrected_flow(wave, eps)
        found |= {"mean_flow_corrected": corrected.value, "mean_flow_bar": corrected.bar}
        found["eps"] = eps
    if film.delta is not None:
        found["mean_flow_square_wave"] = square_wave_flow(film.delta)
    if fluid is None:
        return found
    lowest = np.min(wave.field_function(grid(4096), tension))
    return found | {
        "field_h0": float(fluid.field(peak.value)),
        "field_max": float(fluid.field(peak.value - lowest)),
        "wave_speed": fluid.speed,
        "pressure_scale": fluid.pressure,
        "flow_rate": wave.mean_flow * fluid.speed * fluid.depth,
        "reynolds": fluid.reynolds,
        "field_h0_gaussian": float(fluid.gaussian_field(peak.value)),
    }


def _signals(
    table: FilmFlowScene, wave: Wave, tension: float, fluid: Fluid | None
) -> dict[str, np.ndarray]:
    xi = np.linspace(0.0, 2 * np.pi, table.samples)
    h = wave.height(xi)
    squared = least_field(wave, xi, tension)
    found = {
        "xi": xi,
        "height": h,
        "surface_velocity": surface_velocity(h, wave.constant),
        "film_pressure": wave.pressure(xi),
        "field_squared": squared,
    }
    return found | ({"field": fluid.field(squared)} if fluid else {})


def _curves(table: FilmFlowScene, tension: float, fluid: Fluid | None) -> dict[str, np.ndarray]:
    least, largest = table.curves.range
    delta = np.linspace(least, largest, table.curves.points)
    waves = [CosineWave(each) for each in delta]
    peaks = np.array([wave.peak(tension).value for wave in waves])
    xi = np.linspace(0.0, 2 * np.pi, table.samples)
    shapes = [
        np.maximum(wave.peak(tension).value - wave.field_function(xi, tension), 0.0)
        for wave in map(CosineWave, table.curves.delta)
    ]
    found = {
        "curve_delta": delta,
        "curve_mean_flow": np.array([wave.mean_flow for wave in waves]),
        "curve_square_wave": square_wave_flow(delta),
        "curve_d_max": peaks,
        "field_delta": np.array(table.curves.delta),
        "field_curves": np.array(shapes),
    }
    return found | ({"curve_field_h0": fluid.field(peaks)} if fluid else {})
