"""Bode picture of a Linear system: gain and phase over frequency, one column per input."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike

from wormopt.analysis.linearise import LinearModel
from wormopt.errors import ArgumentError


def frequencies(linear: LinearModel) -> np.ndarray:
    """Choose frequencies that show the effect of poles and zeros, with resonances resolved."""
    corners = np.append(linear.poles, linear.zeros)
    sizes = np.abs(corners)
    corners = corners[sizes > 1e-9 * max(sizes, default=0.0)]
    scales = np.log10(np.abs(corners)) if len(corners) else np.zeros(1)
    even = np.logspace(np.floor(min(scales)) - 1, np.ceil(max(scales)) + 1, 400)
    return np.unique(np.concatenate([even, *map(_around, corners)]))


def _around(corner: complex) -> np.ndarray:
    """Frequencies across the peak or dip of a corner, in the width of its damping."""
    width = max(abs(corner.real) / abs(corner), 1e-6)
    if width > 0.3:  # broad: the even grid resolves it
        return np.zeros(0)
    return abs(corner) * (1 + width * np.linspace(-5, 5, 40)[:, None] / [1, 5]).ravel()


_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00")  # Okabe and Ito; dashed from the fifth on


def bode(
    linear: LinearModel,
    to: str | PathLike[str] | np.ndarray | None = None,
    *,
    omega: ArrayLike | None = None,
) -> Figure:
    """Draw gain and phase of all outputs over frequency, one column of axes per input.

    Parameters
    ----------
    linear : Linear
        The linear system.
    to : path or ndarray of Axes, shape (2, m), optional
        File to write, or where to draw: gains in the first row, phases in the second.
    omega : array_like, shape (k,), optional
        Angular frequencies, positive and ascending; `frequencies` if left out.

    Returns
    -------
    Figure

    Raises
    ------
    ArgumentError
        If the system has no inputs or outputs, the axes are not 2 for each input, or a frequency
        is not positive or a pole.

    Examples
    --------
    >>> from wormopt.analysis.linearise import linearise
    >>> from wormopt.systems.chain.build import chain
    >>> worm = chain(2, mass=1.0, stiffness=10.0, damping=0.5, rest_length=2.0)
    >>> figure = bode(linearise(worm, output="length"), "bode.png")
    >>> len(figure.axes)
    4
    """
    inputs = len(linear.inputs)
    if not (inputs and linear.outputs):
        raise ArgumentError(f"{linear.name} has no inputs or no outputs: nothing to draw")
    omega = frequencies(linear) if omega is None else np.asarray(omega, dtype=float).ravel()
    if not (omega.size and np.all(omega > 0) and np.all(np.diff(omega) > 0)):
        raise ArgumentError("frequencies must be positive and ascend")
    axes = to if isinstance(to, np.ndarray) else _axes(inputs)
    if axes.shape != (2, inputs):
        raise ArgumentError(
            f"a Bode picture needs axes of the shape {(2, inputs)}, not {axes.shape}"
        )
    response = linear.frequency_response(omega)
    for j, (gain, phase) in enumerate(axes.T):
        _column(gain, phase, omega, response[:, j], linear.outputs)
        gain.set_title(f"from {linear.inputs[j]}", fontsize=10.5)
    axes[0, 0].set_ylabel("gain |G(iω)| (dB)")
    axes[1, 0].set_ylabel("phase of G(iω) (°)")
    figure = axes[0, 0].figure
    if isinstance(to, np.ndarray):
        axes[0, -1].legend(title="to", frameon=False)
        return figure
    lines = axes[0, 0].get_lines()
    figure.legend(handles=lines, title="to", frameon=False, loc="outside right upper")
    if to is not None:
        figure.savefig(to, dpi=150)
    return figure


def _axes(inputs: int) -> np.ndarray:
    figure = Figure(figsize=(2.6 + 3.0 * inputs, 5.4), layout="constrained")
    return figure.subplots(2, inputs, sharex=True, sharey="row", squeeze=False)


def _column(
    gain: Axes, phase: Axes, omega: np.ndarray, response: np.ndarray, outputs: tuple[str, ...]
) -> None:
    for i, (name, g) in enumerate(zip(outputs, response, strict=True)):
        style: dict[str, Any] = {
            "color": _COLOURS[i % 4],
            "linestyle": ("-", "--", ":", "-.")[i // 4 % 4],
            "linewidth": 1.6,
        }
        # an output without response has no gain on a log scale
        size = np.where(np.abs(g) > 0, np.abs(g), np.nan)
        gain.plot(omega, 20 * np.log10(size), label=name, **style)
        angle = np.degrees(np.unwrap(np.angle(g)))
        phase.plot(omega, np.where(np.isnan(size), np.nan, angle), **style)
    gain.set_xscale("log")
    phase.set_xscale("log")
    phase.yaxis.set_major_locator(MultipleLocator(90))
    phase.set_xlabel("angular frequency ω (1/time)")
    for axes in (gain, phase):
        axes.grid(color="#E6E6E6", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
