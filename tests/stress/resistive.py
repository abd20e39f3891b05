"""A chain of links, how its points move, and what resists it: written anew, with NumPy alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

Heading = Literal["bisector", "front", "rear"]
Drag = tuple[float, float]
_STEP = 1e-30
_BEHIND = {"bisector": 0.5, "front": 1.0, "rear": 0.0}


@dataclass(frozen=True)
class Chain:
    """A chain by lengths and angles of joints, or by the angles alone."""

    links: int
    lengths: tuple[float, ...] | None  # None: they vary
    heading: Heading

    def places(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (n + 1, 2) and headings (n + 1,), for shapes that may be complex."""
        n = self.links
        sizes, bends = (self.lengths, s) if self.lengths else (s[:n], s[n:])
        x, y, angle, found, looks = 0.0, 0.0, 0.0, [], []
        found.append([x, y])
        looks.append(angle)
        for j in range(n):
            x, y = x - sizes[j] * np.cos(angle), y - sizes[j] * np.sin(angle)
            found.append([x, y])
            if j < n - 1:
                behind = angle - bends[j]
                looks.append(behind + _BEHIND[self.heading] * bends[j])
                angle = behind
        looks.append(angle)
        return np.array(found), np.array(looks)

    def moving(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (m, 2), headings (m,), and velocities (m, 2, 3 + n_s) by the twist and rates."""
        points, looks = self.places(s)
        m = len(points)
        by = np.zeros((m, 2, 3 + len(s)))
        by[:, 0, 0] = by[:, 1, 1] = 1.0
        by[:, :, 2] = np.stack([-points[:, 1], points[:, 0]], axis=1)
        for k in range(len(s)):
            moved = s.astype(complex)
            moved[k] += 1j * _STEP
            by[:, :, 3 + k] = np.imag(self.places(moved)[0]) / _STEP
        return points, looks, by


def turned(look: float) -> np.ndarray:
    """Rows: along a heading, and to its left."""
    c, n = math.cos(look), math.sin(look)
    return np.array([[c, n], [-n, c]])


def resisted(chain: Chain, s: np.ndarray, rods: Drag, masses: Drag) -> np.ndarray:
    """Power as a quadratic form of twist and rates, by Gauss' rule along the rods."""
    points, looks, by = chain.moving(s)
    form = np.zeros((by.shape[2],) * 2)
    for look, velocity in zip(looks, by, strict=True):
        rows = turned(look) @ velocity
        form += rows.T @ np.diag(masses) @ rows
    nodes, weights = np.polynomial.legendre.leggauss(2)
    for j in range(len(points) - 1):
        d = points[j] - points[j + 1]
        along = turned(math.atan2(d[1], d[0]))
        for node, weight in zip((1 + nodes) / 2, weights / 2, strict=True):
            rows = along @ (node * by[j] + (1 - node) * by[j + 1])
            form += weight * math.hypot(*d) * rows.T @ np.diag(rods) @ rows
    return form


def connection(form: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Twist of least power by the rates, and the power that is left."""
    A = -np.linalg.solve(form[:3, :3], form[:3, 3:])
    return A, form[3:, 3:] + form[3:, :3] @ A
