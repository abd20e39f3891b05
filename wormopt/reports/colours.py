"""Colours of a map, and of text on them."""

from __future__ import annotations

from math import isfinite

# From light to dark in perceptually even steps, also for the colour-blind.
_RAMP = ("#f4f1e6", "#d3e4d0", "#a3d0c4", "#6ab6bb", "#3d96ae", "#2d749c", "#2b5285", "#243264")


def shade(value: float, low: float = 0.0, high: float = 1.0) -> str:
    """Colour of a number between two others; the middle one for NaN or an empty range."""
    share = (value - low) / (high - low) if high > low and isfinite(value) else 0.5
    at = min(max(share, 0.0), 1.0) * (len(_RAMP) - 1)
    k = min(int(at), len(_RAMP) - 2)
    mixed = (
        round(a + (at - k) * (b - a))
        for a, b in zip(_parts(_RAMP[k]), _parts(_RAMP[k + 1]), strict=True)
    )
    return "#" + "".join(f"{part:02x}" for part in mixed)


def ink_on(colour: str) -> str:
    """Black or white, whichever has more contrast."""
    return "#000" if (_luminance(colour) + 0.05) ** 2 > 0.05 * 1.05 else "#fff"


def gradient() -> str:
    """The whole colour map as a CSS gradient."""
    return f"linear-gradient(to right, {', '.join(_RAMP)})"


def _parts(colour: str) -> list[int]:
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


def _luminance(colour: str) -> float:
    shares = (part / 255 for part in _parts(colour))
    linear = [s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
