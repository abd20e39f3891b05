"""Residuals of a motion between collocation points, and arcs that are too long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Motion


def defects(motion: Motion) -> np.ndarray:
    """Local error (N,) of every arc: the integral of |x' - f(x, u, ...)| over it, scaled.

    Largest over the states. With prescribed modes a sliding force follows its law; others
    are interpolated. J. T. Betts, Practical Methods for Optimal Control, 4.7 (SIAM 2010).
    """
    arc, mesh = motion.program.arc, motion.mesh
    nodes, weights = np.polynomial.legendre.leggauss(12)
    s, weights = (nodes + 1) / 2, weights / 2
    values = motion.arcs.states
    slopes = np.einsum("sk,rkn->rsn", _slopes(mesh.collocation.nodes, s), values)
    t = motion.breaks[:-1] + np.multiply.outer(s, motion.arcs.duration)
    # just inside the arcs, so that each point belongs to its own
    rates = motion.observe(arc.lawful_ode, t.ravel(order="F"))
    rates = rates.reshape(len(values), len(s), mesh.total, order="F")
    wrong = np.abs(slopes - rates * motion.arcs.duration)
    return np.max(np.einsum("s,rsn->rn", weights, wrong) / arc.x_nominal[:, None], axis=0)


def _slopes(nodes: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Matrix from values at nodes to slopes of the interpolating polynomial at targets."""
    degree = len(nodes) - 1
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, degree)
    primed = np.polynomial.legendre.legder(np.eye(degree + 1)) * 2
    slopes = np.polynomial.legendre.legval(2 * targets - 1, primed)
    return np.linalg.solve(basis.T, slopes).T


def finer(mesh: Mesh, defect: np.ndarray, tolerance: float, most: int = 5) -> Mesh:
    """Split the arcs that err by more than the tolerance into at most `most` parts each.

    `defect` (N,) is from `defects`; the same mesh is returned if no arc errs.
    Raises ArgumentError if durations of arcs are free.
    """
    if mesh.shares is None:
        raise ArgumentError("arcs of free duration are not split; use Mesh.even")
    # an arc's own error decreases with one power more than the sum over all arcs
    order = mesh.collocation.degree + 1
    parts = np.clip(np.ceil((defect / tolerance) ** (1 / order)), 1, most).astype(int)
    shares = np.repeat(np.array(mesh.shares) / parts, parts)
    counts = np.bincount(mesh.phase, weights=parts).astype(int)
    return replace(mesh, arcs=tuple(counts.tolist()), shares=tuple(shares.tolist()))
