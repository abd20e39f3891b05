"""What limits an optimal crawl: sensitivities to its limits, and a bound on every crawl."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wormopt.model.friction import Viscous
from wormopt.ocp.motion import Motion
from wormopt.ocp.optimise import Optimum
from wormopt.study.types import per
from wormopt.systems.chain.crawl_study import CrawlStudy
from wormopt.systems.chain.loops import laws_of
from wormopt.systems.shared.optimum import sample_motion

# Elasticities below this are rounding.
_NOTHING = 1e-5
# Speed at which velocity-weakening friction has fallen to its least value.
_FAST = 1e150


# -- sensitivities ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Slope:
    """Derivative of the maximised speed, or of the cost, by one limit."""

    name: str  # "actuator_force[1]", "length.longest"
    value: float
    quantity: str
    derivative: float
    elasticity: float


def slopes(study: CrawlStudy, optimum: Optimum, cycles: int) -> list[Slope]:
    """Derivatives of the maximised speed, or of the cost, by all limits, from the multipliers.

    The order of rests does not change. The derivative by a limit that does not bind is 0.
    """
    size = abs(optimum.objective) or 1.0
    sign = 1.0 if study.objective.minimise else -1.0
    found = []
    for name, value, quantity, slope in _slopes(study, optimum, cycles):
        elasticity = sign * slope * value / size
        binds = abs(elasticity) > _NOTHING
        known = (sign * slope, elasticity) if binds else (0.0, 0.0)
        found.append(Slope(name, value, quantity, *known))
    return found


def _slopes(
    study: CrawlStudy, optimum: Optimum, cycles: int
) -> Iterator[tuple[str, float, str, float]]:
    limits, links = study.limits, study.worm.links

    def price(name: str) -> tuple[np.ndarray, np.ndarray]:
        nothing = np.zeros(links)
        return optimum.prices.get(name, (nothing, nothing))

    shortest, longest = limits.period_range
    low, high = (float(side[0]) / cycles for side in price("duration"))
    if limits.tick is None:  # else the best objective changes in jumps
        if shortest == longest:
            yield "period", shortest, "time", low + high
        else:
            yield "period.shortest", shortest, "time", low
            yield "period.longest", longest, "time", high
    uneven = isinstance(limits.actuator_force, tuple)
    low, high = price("limits.actuator_force" if uneven else "input")
    yield from _each("actuator_force", limits.actuator_force, "force", high - low)
    if (ranges := limits.length_ranges(links)) is not None:
        low, high = price("limits.length")
        alike = len(set(ranges)) == 1
        for end, side, which in (("shortest", low, 0), ("longest", high, 1)):
            value = ranges[0][which] if alike else tuple(r[which] for r in ranges)
            yield from _each(f"length.{end}", value, "length", side)
    for key, quantity in (("rate", "speed"), ("acceleration", "acceleration")):
        low, high = price(f"limits.{key}")
        yield from _each(key, getattr(limits, key), quantity, high - low)
    for key, quantity in (("actuator_power", "power"), ("energy_per_cycle", "energy")):
        yield from _each(key, getattr(limits, key), quantity, price(f"limits.{key}")[1])
    yield from _each("objective.speed", study.objective.speed, "speed", price("objective.speed")[0])


def _each(
    key: str, value: float | tuple[float, ...] | None, quantity: str, slope: np.ndarray
) -> Iterator[tuple[str, float, str, float]]:
    """One row for each number as written."""
    if isinstance(value, tuple):
        for k, one in enumerate(value):
            yield f"{key}[{k}]", one, quantity, float(slope[k])
    elif value is not None:
        yield key, value, quantity, float(slope.sum())


# -- limits between points of the mesh ------------------------------------------------------------


def excess_of(motion: Motion) -> dict[str, float]:
    """Largest excess of each limit between points of the mesh, as a share of the limit."""
    bounds = motion.program.problem.path_constraints
    limits = {each.name: each for each in bounds if each.name.startswith("limits.")}
    values = sample_motion(motion, {n: each.expression for n, each in limits.items()}).values
    found = dict[str, float]()
    for name, limit in limits.items():
        low, high = (np.reshape(side, (-1, 1)) for side in (limit.lower, limit.upper))
        beyond = np.maximum(values[name] - high, low - values[name])
        found[name] = max(0.0, float(beyond.max())) / limit.nominal
    return found


# -- a bound on every crawl ------------------------------------------------------------------------


def bound_of(study: CrawlStudy) -> float | None:
    """Least value of the objective that any crawl within the limits can have; None if unknown.

    Over a cycle, springs and masses keep their energy. Actuators give what dashpots and the ground
    take. With a_j, the mean of |l_j'|, a link gives at most u_j a_j - d_j a_j^2, and ground, drag
    and load take at least sum(F+_i + load_i) V + sum(k_i) V^2 at the mean speed V.
    """
    worm, aim, masses = study.worm, study.objective, study.worm.links + 1
    laws = laws_of(worm)
    drag = sum(per(worm.drag, masses)) + sum(
        float(law.drag) for law in laws if isinstance(law, Viscous)
    )
    force = sum(per(worm.pull, masses)) + sum(
        -float(law.slip_force(_FAST, 1)) for law in laws if not isinstance(law, Viscous)
    )
    if aim.minimise is not None:
        return max(0.0, force + drag * (aim.speed or 0.0)) / sum(per(worm.mass, masses))
    power = sum(_power(*one) for one in _links(study))
    root = math.sqrt(force**2 + 4 * drag * power)
    if not math.isfinite(power) or (force <= 0.0 and not drag):
        return None
    # the larger V with drag V^2 + force V = power, without cancellation
    speed = 2 * power / (force + root) if force > 0.0 else (root - force) / (2 * drag)
    if aim.effort and force > 0.0:
        # with less force an actuator gives less power, but costs less
        worth = (_worth(*one, price=force, effort=aim.effort) for one in _links(study))
        speed = min(speed, sum(worth))
    return -speed


def _links(study: CrawlStudy) -> Iterator[tuple[float, float, float, float]]:
    """Largest force, damping, largest rate and power of each link."""
    limits, n = study.limits, study.worm.links
    ranges = limits.length_ranges(n) or ((0.0, math.inf),) * n
    most = per(limits.acceleration or math.inf, n)
    # a link that turns within its range at a bounded acceleration has a bounded rate
    implied = [math.sqrt(a * (b[1] - b[0])) for a, b in zip(most, ranges, strict=True)]
    rates = map(min, per(limits.rate or math.inf, n), implied)
    powers = per(limits.actuator_power or math.inf, n)
    forces = per(limits.actuator_force, n)
    return zip(forces, per(study.worm.damping, n), rates, powers, strict=True)


def _power(force: float, damping: float, rate: float, power: float) -> float:
    """Largest mean power of a link's actuator less that of its dashpot."""
    best = min(rate, power / force, force / (2 * damping) if damping else math.inf)
    return force * best - damping * best**2 if math.isfinite(best) else math.inf


def _worth(
    force: float, damping: float, rate: float, power: float, *, price: float, effort: float
) -> float:
    """Largest power over the price, less the effort of the force that gives it."""
    # the force at which another bound holds, and where more force costs as much as it gives
    places = [
        force,
        2 * damping * rate,
        rate / (2 * effort * price),
        power / rate if rate else 0.0,
        math.sqrt(2 * damping * power) if damping else 0.0,
        (damping * power**2 / (effort * price)) ** 0.25 if damping else 0.0,
    ]
    inside = [s for s in places if 0.0 < s <= force]
    return max(0.0, *(_power(s, damping, rate, power) / price - effort * s**2 for s in inside))
