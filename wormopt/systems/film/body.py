"""Bodies with a mass on a given wave, which they do not change: floats, bodies on the ground.

Both are pushed by the fluid and held back by it, and by friction where there is ground:
m x'' = push - drag x' + friction, over their length. Scales as in (25).
"""

from __future__ import annotations

import math
from collections.abc import Callable
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

# Means over the length by Gauss' rule, of the fewest nodes that agree to this share with the next.
_AGREED, _PHASES = 1e-12, 256
_NODES = (8, 16, 32, 64, 128, 256, 512)


@dataclass(frozen=True)
class HeavyFloat:
    """A float that bends with the surface, and slides down its slope.

    The fluid's shear on it is eta (x' - u_s) / h; the film bears its weight.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    length : float, optional
        0 for a small one, below 2 pi.
    weight : float, optional
        Per area times (k d)² / (eta omega), 0 or above.

    Raises
    ------
    ArgumentError
        If a number is out of range.

    Examples
    --------
    >>> import wormopt as wo
    >>> body = wo.film.HeavyFloat(wo.film.CosineWave(0.5))
    >>> round(float(body.velocity(0.0)), 6)  # of the surface there
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
        """Force over the length on the body at rest with its middle at the phase xi.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase of its middle.

        Returns
        -------
        float, ndarray or casadi.SX
            Per area, in units of eta omega / (k d).
        """
        h, half = self.wave.height, self.length / 2
        rise = (h(xi + half) - h(xi - half)) / self.length if half else h(xi, 1)
        return body_velocity(self.wave, xi, self.length) * self.drag(xi) + self.weight * rise

    def drag(self, xi: Any) -> Any:
        """What its own motion takes off, over its velocity.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase of its middle.

        Returns
        -------
        float, ndarray or casadi.SX
            Above 0.
        """
        return self.wave.inverse(xi, self.length) if self.length else 1 / self.wave.height(xi)

    def velocity(self, xi: Any) -> Any:
        """Velocity without mass.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase of its middle.

        Returns
        -------
        float, ndarray or casadi.SX
            Over the speed of the wave.
        """
        return self.push(xi) / self.drag(xi)


@dataclass(frozen=True)
class LyingBody:
    """A body on the ground in the film.

    Over its height b the fluid that the wave needs, Q = h + C, goes through the gap h - b over a
    floor that moves at x' = v, which takes b v of it along: that takes the pressure gradient
    -3 (Q - v h) / (h - b)³. On its ends only capillarity acts: the magnetic pressure on a body that
    is not magnetic makes up for the rest.

    Parameters
    ----------
    wave : CosineWave or FourierWave
        Shape of the surface.
    height : float, optional
        Over the mean thickness; 0, or below the least thickness of the film.
    length : float, optional
        0 for a short one, below 2 pi.
    tension : float, optional
        W of (25), which acts on its ends.

    Raises
    ------
    ArgumentError
        If a number is out of range, or too few nodes tell means over its length.

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
                f"a body in the film has a height from 0 to below its least thickness, {least:.6g} "
                f"of the mean, not {self.height:g}"
            )
        if not 0 <= self.tension < math.inf:
            raise ArgumentError(f"tension must be 0 or above, not {self.tension:g}")
        _ = self._rule  # refuses what no rule tells

    def push(self, xi: Any) -> Any:
        """Force over the length on the body at rest with its middle at the phase xi.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase of its middle.

        Returns
        -------
        float, ndarray or casadi.SX
            Per area, in units of eta omega / (k d).
        """
        h, C, b = self.wave.height, self.wave.constant, self.height
        shear = self._mean(xi, lambda at: 3 * (h(at) + C) / (h(at) - b) ** 2)
        half = self.length / 2
        ends = (h(xi - half, 2) - h(xi + half, 2)) / self.length if half else -h(xi, 3)
        return shear + self.tension * b * ends

    def drag(self, xi: Any) -> Any:
        """What its own motion takes off, over its velocity.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase of its middle.

        Returns
        -------
        float, ndarray or casadi.SX
            Above 0.
        """
        h, b = self.wave.height, self.height
        return self._mean(xi, lambda at: 3 * h(at) / (h(at) - b) ** 2)

    def velocity(self, xi: np.ndarray, forward: float = 0.0, backward: float = 0.0) -> np.ndarray:
        """Velocity without mass against a friction either way: 0 where the ground holds it.

        Parameters
        ----------
        xi : float, ndarray or casadi.SX
            Phase of its middle.
        forward, backward : float, optional
            Friction of the ground, 0 or above.

        Returns
        -------
        float, ndarray or casadi.SX
            Over the speed of the wave.
        """
        push = self.push(xi)
        return (np.maximum(push - forward, 0.0) + np.minimum(push + backward, 0.0)) / self.drag(xi)

    def _mean(self, xi: Any, of: Callable[[Any], Any]) -> Any:
        places, weights = self._rule
        return sum(w * of(xi + s) for s, w in zip(places, weights, strict=True))

    @cached_property
    def _rule(self) -> tuple[list[float], list[float]]:
        """Places round the middle, and weights that add up to 1."""
        if not self.length:
            return [0.0], [1.0]
        rule, means = self._nodes(_NODES[0])
        for count in _NODES[1:]:
            finer, found = self._nodes(count)
            if np.all(np.abs(found - means) <= _AGREED * found):
                return rule[0].tolist(), rule[1].tolist()
            rule, means = finer, found
        raise ArgumentError(
            "the film over the body is so thin somewhere that its forces are not told by "
            f"{_NODES[-2]} places along it; take a shorter or a lower body"
        )

    def _nodes(self, count: int) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Places and weights of a rule, and its means of powers of the gap at many phases."""
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
    """Build m x'' = push - drag x' + friction, where friction of the ground sticks and slips.

    Parameters
    ----------
    body : HeavyFloat or LyingBody
        The body and its wave.
    mass : float
        Per area times omega d / eta, above 0: the time in which it takes the fluid's velocity.
    forward, backward : float, optional
        Friction per area that opposes motion with the wave and against it, times k d /
        (eta omega), 0 or above; only of a body on the ground.
    position : float, optional
        Place of its middle at time 0, where it rests.

    Returns
    -------
    Model
        States ``position``, ``velocity``, and since the start ``work`` and ``impulse`` of all
        forces; parameters ``mass`` and the law's; output ``phase`` t - x; one contact, "body", if
        it lies on the ground. A switch without effect fires when a trough of the cosine wave
        passes.

    Raises
    ------
    ArgumentError
        If a number is out of range, or a float has friction.

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
        raise ArgumentError("a float has no friction: give forward and backward of a LyingBody")
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
