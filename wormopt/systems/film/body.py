"""Bodies with mass in a given wave, which they do not change: floats, bodies on the ground.

The fluid pushes and damps them, and the ground adds friction: m x'' = push - drag x' + friction,
over their length. Scales as in eq. 25 of Zimmermann et al. 2007.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.lift import lift
from wormopt.model.model import TINY, Contact, Model, Output, Signal
from wormopt.systems.film.float import body_velocity, checked_lengths, finite, overtaken
from wormopt.systems.film.shapes import Wave, grid

# Means over the length by Gauss' rule, with the fewest nodes that agree to this share with the
# next.
_AGREED, _PHASES = 1e-12, 256
_NODES = (8, 16, 32, 64, 128, 256, 512)


@dataclass(frozen=True)
class HeavyFloat:
    """A float that bends with the surface and slides down its slope.

    The shear of the fluid on the float is eta (x' - u_s) / h; the film carries its weight. The
    scales are those of eq. 25 of Zimmermann et al. 2007.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    length : float, optional
        Length in units of 1/k, from 0 (a small float) to below 2 pi.
    weight : float, optional
        Weight per area times (k d)² / (eta omega), 0 or above.

    Raises
    ------
    ArgumentError
        If a parameter is out of range.

    Examples
    --------
    >>> import wormopt as wo
    >>> body = wo.film.HeavyFloat(wo.film.CosineWave(0.5))
    >>> round(float(body.velocity(0.0)), 6)  # the surface velocity there
    0.833333
    """

    wave: Wave
    length: float = 0.0
    weight: float = 0.0

    def __post_init__(self) -> None:
        checked_lengths(self.length)
        if not 0 <= self.weight < math.inf:
            raise ArgumentError(f"weight must be 0 or above, not {self.weight:g}")

    def push(self, xi: Any) -> Any:
        """Force per area on the body at rest.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x of its middle in rad.

        Returns
        -------
        float, ndarray or casadi.SX
            Mean force per area over the length, in units of eta omega / (k d).
        """
        h, half = self.wave.height, self.length / 2
        rise = (h(xi + half) - h(xi - half)) / self.length if half else h(xi, 1)
        return body_velocity(self.wave, xi, self.length) * self.drag(xi) + self.weight * rise

    def drag(self, xi: Any) -> Any:
        """Drag coefficient: force against the body's own motion over its velocity.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x of its middle in rad.

        Returns
        -------
        float, ndarray or casadi.SX
            Positive coefficient, dimensionless.
        """
        return self.wave.inverse(xi, self.length) if self.length else 1 / self.wave.height(xi)

    def velocity(self, xi: Any) -> Any:
        """Velocity of the same float without mass.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x of its middle in rad.

        Returns
        -------
        float, ndarray or casadi.SX
            Velocity over the wave speed.
        """
        return self.push(xi) / self.drag(xi)


@dataclass(frozen=True)
class LyingBody:
    """A body on the ground in the film.

    The flow Q = h + C of the wave passes through the gap h - b over the body of height b, which
    moves with x' = v and transports b v itself. This requires the pressure gradient -3 (Q - v h) /
    (h - b)³. Only capillarity acts on the ends, since the magnetic pressure on a nonmagnetic body
    balances the rest. The scales are those of eq. 25 of Zimmermann et al. 2007.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    height : float, optional
        Height b over the mean thickness, from 0 to below the least thickness of the film.
    length : float, optional
        Length in units of 1/k, from 0 (a short body) to below 2 pi.
    tension : float, optional
        Surface tension W (eq. 25), which acts on the ends.

    Raises
    ------
    ArgumentError
        If a parameter is out of range, or the quadrature over the length does not converge.

    Examples
    --------
    >>> import wormopt as wo
    >>> body = wo.film.LyingBody(wo.film.CosineWave(0.5))
    >>> round(float(max(body.push(wo.film.grid(4096)))), 4)  # 3 / (4 |C|)
    1.125
    """

    wave: Wave
    height: float = 0.0
    length: float = 0.0
    tension: float = 0.0

    def __post_init__(self) -> None:
        checked_lengths(self.length)
        least = float(np.min(self.wave.height(grid(4096))))
        if not 0 <= self.height < least:
            raise ArgumentError(
                f"the height must be from 0 to below the least film thickness, {least:.6g} of the "
                f"mean, not {self.height:g}"
            )
        if not 0 <= self.tension < math.inf:
            raise ArgumentError(f"tension must be 0 or above, not {self.tension:g}")
        _ = self._rule  # refuses what no rule resolves

    def push(self, xi: Any) -> Any:
        """Force per area on the body at rest.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x of its middle in rad.

        Returns
        -------
        float, ndarray or casadi.SX
            Mean force per area over the length, in units of eta omega / (k d).
        """
        h, C, b = self.wave.height, self.wave.constant, self.height
        shear = self._mean(xi, lambda at: 3 * (h(at) + C) / (h(at) - b) ** 2)
        half = self.length / 2
        ends = (h(xi - half, 2) - h(xi + half, 2)) / self.length if half else -h(xi, 3)
        return shear + self.tension * b * ends

    def drag(self, xi: Any) -> Any:
        """Drag coefficient: force against the body's own motion over its velocity.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x of its middle in rad.

        Returns
        -------
        float, ndarray or casadi.SX
            Positive coefficient, dimensionless.
        """
        h, b = self.wave.height, self.height
        return self._mean(xi, lambda at: 3 * h(at) / (h(at) - b) ** 2)

    def velocity(self, xi: np.ndarray, forward: float = 0.0, backward: float = 0.0) -> np.ndarray:
        """Velocity of the same body without mass, with friction; 0 where the ground holds it.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase t - x of its middle in rad.
        forward : float, optional
            Friction per area against motion with the wave, 0 or above.
        backward : float, optional
            Friction per area against motion opposite to the wave, 0 or above.

        Returns
        -------
        float, ndarray or casadi.SX
            Velocity over the wave speed.
        """
        push = self.push(xi)
        return (np.maximum(push - forward, 0.0) + np.minimum(push + backward, 0.0)) / self.drag(xi)

    def _mean(self, xi: Any, of: Callable[[Any], Any]) -> Any:
        places, weights = self._rule
        return sum(w * of(xi + s) for s, w in zip(places, weights, strict=True))

    @cached_property
    def _rule(self) -> tuple[list[float], list[float]]:
        """Nodes relative to the middle, and weights with sum 1."""
        if not self.length:
            return [0.0], [1.0]
        rule, means = self._nodes(_NODES[0])
        for count in _NODES[1:]:
            finer, found = self._nodes(count)
            if np.all(np.abs(found - means) <= _AGREED * found):
                return rule[0].tolist(), rule[1].tolist()
            rule, means = finer, found
        raise ArgumentError(
            f"the film over the body is so thin that {_NODES[-2]} nodes along it do not resolve "
            "its forces; use a shorter or lower body"
        )

    def _nodes(self, count: int) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Nodes and weights of a rule, and its means of powers of the gap at many phases."""
        nodes, weights = np.polynomial.legendre.leggauss(count)
        places, shares = nodes * self.length / 2, weights / 2
        gap = self.wave.height(grid(_PHASES)[:, None] + places) - self.height
        return (places, shares), np.stack([gap**-2 @ shares, gap**-1 @ shares])


def carried_body(
    body: HeavyFloat | LyingBody,
    *,
    mass: float,
    forward: float = 0.0,
    backward: float = 0.0,
    position: float = 0.0,
) -> Model:
    """Build the model of a body in a wave: m x'' = push - drag x' + friction.

    Friction of the ground sticks and slips.

    Parameters
    ----------
    body : HeavyFloat or LyingBody
        The body and its wave.
    mass : float
        Mass per area times omega d / eta, above 0. It is the time constant with which the body
        takes the velocity of the fluid.
    forward : float, optional
        Friction per area against motion with the wave, times k d / (eta omega), 0 or above; for a
        body on the ground only.
    backward : float, optional
        Friction per area against motion opposite to the wave, in the same unit.
    position : float, optional
        Initial position of its middle, in units of 1/k. The body starts at rest.

    Returns
    -------
    Model
        States: ``position``, ``velocity``, and ``work`` and ``impulse`` of all forces since the
        start. Parameters: ``mass`` and those of the friction law. Output: ``phase`` t - x. A body
        on the ground has one contact, "body". A switch without effect marks the times at which a
        trough of the cosine wave passes.

    Raises
    ------
    ArgumentError
        If a parameter is out of range, or a float has friction.

    Examples
    --------
    >>> import wormopt as wo
    >>> lying = wo.film.LyingBody(wo.film.CosineWave(0.5))
    >>> wo.film.carried_body(lying, mass=0.1, forward=1.5, backward=1.5).n_x
    4
    """
    place = finite("position", position).item()
    if not 0 < mass < math.inf:
        raise ArgumentError(f"mass must be above 0 and finite, not {mass:g}")
    (law,), numbers = lift([Coulomb(forward, backward)])
    grounded = isinstance(body, LyingBody)
    if not grounded and (forward or backward):
        raise ArgumentError(
            "forward and backward are friction, which a float does not have; leave them out, or "
            "write a LyingBody"
        )
    t, states, friction = ca.SX.sym("t"), ca.SX.sym("x", 4), ca.SX.sym("friction")
    m = ca.SX.sym("mass")
    x, v = states[0], states[1]
    xi = t - x
    force = body.push(xi) - body.drag(xi) * v + (friction if grounded else 0.0)
    return Model(
        "body on a film",
        x=[
            Signal("position", x, "length", value=place),
            Signal("velocity", v, "speed", value=0.0),
            Signal("work", states[2], "1", value=0.0),
            Signal("impulse", states[3], "1", value=0.0),
        ],
        ode=ca.vertcat(v, force / m, force * v, force),
        p=[Signal("mass", m, "1", lower=TINY, value=mass), *(numbers if grounded else ())],
        t=t,
        outputs=[Output("phase", xi, "angle")],
        contacts=[Contact("body", v, friction, law, max(forward, backward, 1.0))] * grounded,
        switches=overtaken("body", xi, states),
    )


def mean_velocity(places: np.ndarray, times: Sequence[float]) -> float:
    """Mean velocity of a body between two passages of a trough, as exact as their times.

    Its `places` (2,) at the `times` decide how often the wave overtook the body: not at all if it
    swings in a trough, a negative number if the body overtook the wave.
    """
    took = times[-1] - times[0]
    return 1 - 2 * math.pi * round((took - float(np.diff(places)[0])) / (2 * math.pi)) / took
