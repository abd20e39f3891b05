"""Pictures of results; all they know is the names of a Result's variables and scalars.

One file per family of pictures, and a line in `PICTURES` for each picture.
"""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure

from wormopt.plotting.parts import RED, STYLE
from wormopt.result import Result

__all__ = ["PICTURES", "Picture", "draw", "figure"]

_DPI, _FILM_DPI = 150, 80
_FRAMES_PER_SECOND = 12


@dataclass(frozen=True)
class Picture:
    """How to draw one kind of picture."""

    source: str  # "module:function" below wormopt.systems: from a Result its untitled Figure
    needs: tuple[str, ...]  # variables the Result must have
    # whether the module has pose(figure, result, frame), frame one of FRAMES
    animated: bool = False

    def load(self) -> tuple[Any, Callable[[Result], Figure]]:
        """Load the module, and the function that composes the Figure."""
        name, _, compose = self.source.partition(":")
        module = import_module(f"wormopt.systems.{name}")
        return module, getattr(module, compose)


_CYCLE = ("time", "resting")
PICTURES: dict[str, Picture] = {
    "gait": Picture("spiked.plots.gaits:gait", (*_CYCLE, "length", "rate")),
    "motion": Picture("spiked.plots.gaits:motion", (*_CYCLE, "position")),
    "spikes": Picture(
        "spiked.plots.gaits:spikes",
        (*_CYCLE, "reaction", "reaction_mean", "sigma", "actuator_force"),
    ),
    "limits": Picture("spiked.plots.gaits:limits", ("limit_elasticity",)),
    "front": Picture("spiked.plots.gaits:front", ("front_speed", "front_value", "front_accepted")),
    "certificate": Picture(
        "spiked.plots.gaits:certificate", ("proof_time", "proof_bound", "proof_value")
    ),
    "animation": Picture("spiked.plots.gaits:first_frame", (*_CYCLE, "position"), animated=True),
    "trackers": Picture(
        "chain.plots.simulation:trackers",
        ("time", "reference", "length", "error_norm", "tube", "input", "position"),
    ),
    "bands": Picture("chain.plots.simulation:bands", ("time", "reference", "quantile")),
    "convergence": Picture(
        "chain.plots.optimum:convergence",
        ("width", "smoothed_error", "arcs", "complementarity_error"),
    ),
    "comparison": Picture(
        "chain.plots.comparison:comparison",
        ("time", "error_norm", "drawn_input_rms", "drawn_error_peak"),
    ),
    "draws": Picture("chain.plots.comparison:draws", ("drawn_time_outside_tube", "drawn_distance")),
    "signals": Picture("chain.plots.simulation:signals", ("time",)),
    "velocity": Picture("coils.plots.magnetics:velocity", ("time", "velocity", "late_velocity")),
    "resonance": Picture(
        "coils.plots.magnetics:resonance",
        ("detuning", "curve_detuning", "curve_velocity", "curve_amplitude", "curve_stable"),
    ),
    "waveform": Picture(
        "pair.plots.waveform:waveform",
        ("instant", "field", "field_harmonic", "stretch", "stretch_harmonic", "velocity"),
    ),
    "reversals": Picture(
        "pair.plots.averaging:reversals",
        ("share", "relative_velocity", "time", "center_velocity_averaged"),
    ),
    "film": Picture(
        "film.plots.film:film",
        ("xi", "height", "surface_velocity", "field_squared", "curve_delta", "field_curves"),
    ),
    "ride": Picture(
        "film.plots.film:ride", ("time", "float_position", "xi", "height", "body_velocity")
    ),
    "forward": Picture(
        "film.plots.thin_film:forward",
        ("xi", "time", "thickness", "thickness_end", "field_pressure"),
    ),
    "basins": Picture(
        "film.plots.thin_film:basins", ("map_delta", "map_tension", "map_outcome", "map_growth")
    ),
    "film_wave": Picture(
        "film.plots.film:film_wave", ("xi", "height", "field_pressure", "surface_velocity")
    ),
    "travelling_field": Picture(
        "coils.plots.coils:travelling_field",
        (
            "place",
            "time",
            "field",
            "coil_place",
            "phase",
            "square_mean",
            "square_low",
            "square_high",
        ),
    ),
    "row_currents": Picture(
        "coils.plots.coils:row_currents",
        ("phase", "square_target", "square_mean", "square_low", "square_high", "time", "current"),
    ),
    "coil_pressure": Picture(
        "coils.plots.hydrostatics:coil_pressure",
        ("x", "surface", "pressure", "inside_z", "inside_pressure", "map_x", "induction_x"),
    ),
    "rod_frequency": Picture(
        "channel.plots.rod:rod_frequency", ("curve_rate", "curve_velocity", "curve_error")
    ),
    "rod_motion": Picture(
        "channel.plots.rod:rod_motion",
        ("time", "centre", "frame", "rod_x", "rod_y", "first_coil", "coils_on"),
    ),
    "membrane": Picture(
        "coils.plots.hydrostatics:membrane",
        ("front_thickness", "front_loss", "front_strain", "front_contact_pressure"),
    ),
    "steps": Picture(
        "spiked.plots.stepper:steps",
        ("time", "length", "commanded", "turn_rate", "turn_length", "position", "position_ideal"),
    ),
    "channel_velocity": Picture(
        "channel.plots.channel:channel_velocity", ("frequency", "velocity")
    ),
    "segment_shapes": Picture(
        "channel.plots.channel:segment_shapes",
        ("share", "x", "y", "theta", "distance_max", "exact"),
    ),
    "stress_strain": Picture(
        "coils.plots.magnetics:stress_strain",
        ("strain", "stress_with_field", "stress_without_field"),
    ),
}
"""Every picture by its name, the word in a scene's ``want``."""

_SIMULATED = Picture("chain.plots.simulation:motion", ("time", "position"))
# Pictures that are another one in results of some kinds of scene.
_BY_KIND = {(kind, "motion"): _SIMULATED for kind in ("track", "track-optimal", "simulate")}
# The coordinate of optimal motions has another name.
_OPTIMAL = Picture("chain.plots.optimum:signals", ("instant",))
_BY_KIND |= {
    (kind, "signals"): _OPTIMAL for kind in ("slide", "two-mass", "capsule", "optimal-crawl")
}
_BY_KIND["rod-motion", "animation"] = Picture(
    "channel.plots.rod:first_frame",
    ("frame", "rod_x", "rod_y", "first_coil", "coils_on"),
    animated=True,
)


def figure(result: Result, picture: str) -> Figure:
    """Compose a picture, with the title of the result and a mark if the result failed.

    `picture` is a key of `PICTURES`; an animation gives its first frame. ValueError if
    there is no such picture, KeyError naming variables that the result lacks.
    """
    if picture not in PICTURES:
        raise ValueError(f"no picture {picture!r}; there are {', '.join(PICTURES)}")
    chosen = _chosen(result, picture)
    missing = [name for name in chosen.needs if name not in result]
    if missing:
        error = KeyError(", ".join(missing))
        error.add_note(f"the picture {picture!r} is drawn from these variables of the result")
        raise error
    with rc_context(STYLE):
        _, compose = chosen.load()
        drawn = compose(result)
        _entitle(drawn, result)
    return drawn


def draw(result: Result, picture: str, path: str | Path) -> None:
    """Write a picture, a key of `PICTURES`, to a file, which appears only when it is complete.

    Suffix: one matplotlib knows, ``.gif`` for an animation. ValueError if there is no such
    picture, KeyError naming missing variables, OSError if the file cannot be written.
    """
    path = Path(path)
    unfinished = path.with_name(f".unfinished-{path.name}")
    drawn = figure(result, picture)
    try:
        with rc_context(STYLE), warnings.catch_warnings():
            # a title may hold letters that the font lacks; the picture is good all the same
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            chosen = _chosen(result, picture)
            if chosen.animated:
                _film(result, chosen, drawn, unfinished)
            else:
                drawn.savefig(unfinished, dpi=_DPI)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _chosen(result: Result, picture: str) -> Picture:
    return _BY_KIND.get((result.kind, picture), PICTURES[picture])


def _entitle(drawn: Figure, result: Result) -> None:
    title = "\n".join(textwrap.wrap(result.title or result.scene, 66))
    drawn.suptitle(title, fontsize=12, weight="bold", parse_math=False)
    if result.status == "failed":
        reason = textwrap.wrap(f"failed: {result.reason or 'no reason given'}", 84)
        drawn.axes[0].set_title(
            "\n".join(reason), loc="left", color=RED, weight="bold", parse_math=False
        )
        drawn.set_facecolor("#FDF0EC")


def _film(result: Result, picture: Picture, drawn: Figure, path: Path) -> None:
    drawn.draw_without_rendering()
    drawn.set_layout_engine("none")  # laid out once: nothing shifts from frame to frame
    writer = PillowWriter(fps=_FRAMES_PER_SECOND)
    with writer.saving(drawn, path, dpi=_FILM_DPI):
        module, _ = picture.load()
        for frame in range(module.FRAMES):
            module.pose(drawn, result, frame)
            writer.grab_frame()
