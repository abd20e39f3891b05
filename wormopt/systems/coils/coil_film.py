"""Kind "coil-film": a film of magnetic fluid over a row of coils, from switch to switch."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import Fault
from wormopt.result import left_out
from wormopt.study import (
    Given,
    array,
    check,
    entry,
    facts,
    on_use,
    scalar,
    warnings,
    whole,
)
from wormopt.systems.coils.over_coils import OverCoils
from wormopt.systems.coils.tables import Switching

with on_use():
    import numpy as np

    from wormopt.magnetics.hydrostatics import field_stiffness, growth_rate, normal_field_number
    from wormopt.model.gait import Gait
    from wormopt.systems.coils.film import inside_field

_SMALL = 0.1  # share of a neglected effect from which it is reported
_SPOTS = 7  # number of places and times at which fields are compared
_KEEPS_UP = 0.9  # share of a pitch moved per switch


class SwitchedTime(Given):
    """Duration of the simulation."""

    switches: int = whole(1, 1000, "switching steps, the first from a flat film")
    samples: int = whole(1, 64, "number of states kept in each step", default=4)


class CoilFilm(OverCoils, kind="coil-film"):
    """Simulate a magnetic fluid film over a row of coils switched one after another.

    The thin-film equation has weight, surface tension, viscosity, and the field of all coils at the
    surface, with its ripple and the ends of the row. The simulation starts from a flat film. Theory
    and assumptions: [theory-film.md](../theory-film.md#5-a-film-over-switched-coils). `units` must
    be `"SI"`.

    The trust report has the check `half the cells`: the largest difference of the end state to
    that on half the cells, over the depth. About a third of it is the error on all cells. Further
    checks are `smaller steps` (the same for a tenth of the tolerance), `volume`, `top`, `field` (at
    the surface, against the row's own formula), and `flat surface` (normal-field instability).
    `warnings` report effects that lubrication and the flat layer's field neglect.
    """

    pictures: ClassVar = {
        "coil_film": "surface over place and time, at a few times, and the flow",
        "cargo": "the float on the film at a few times, to scale, and its path",
        "animation": "film, float and the coils that are on, as a moving GIF",
    }
    headline: ClassVar = (
        "carried_per_switch", "thickness_max", "thickness_min", "own_field_left_out", "grid_error",
    )  # fmt: skip
    remedy = "lower switching.ampere_turns, or raise film.top, grid.cells or fluid.viscosity"

    switching: Switching = entry("sequence of active coils")
    time: SwitchedTime = entry("duration")

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.switching.faults_in(self.coils)
        if self.cargo is None and "cargo" in self.want:
            yield "want", 'the plot "cargo" needs a float; write a table [cargo]'

    @cached_property
    def currents(self) -> Gait:
        return self.switching.currents(self.coils)

    @cached_property
    def times(self) -> np.ndarray:
        steps = self.time.switches
        return np.linspace(0, steps / self.switching.frequency, steps * self.time.samples + 1)

    def currents_of_steps(self, count: int) -> np.ndarray:
        """Return the currents of the steps that occur, shape (steps, coils); `count` at most."""
        pieces = self.currents.pieces
        steps = np.linspace(0, pieces - 1, min(count, pieces)).astype(int)
        return np.hstack([self.currents.on_piece(k, np.zeros(1)) for k in steps.tolist()]).T

    @array("length", "face", "position of the face between two cells")
    def face(self) -> np.ndarray:
        return self.layer.start + self.layer.step * np.arange(self.layer.cells + 1)

    @array("flow_per_width", "time face", "flow to the right")
    def flow(self) -> np.ndarray:
        return self.motion["flow"].T

    @array("speed", "time", "velocity of the float", when="cargo")
    def float_velocity(self) -> np.ndarray:
        return self.motion["velocity"][0]

    # -- what the coils move -----------------------------------------------------------------------

    @scalar("area", "fluid that passed the middle of the row, per width")
    def carried(self) -> float:
        layer, h = self.layer, self.thickness
        middle = layer.start + layer.length / 2
        right = np.clip((layer.places + layer.step / 2 - middle) / layer.step, 0, 1)
        return float(layer.step * ((h[-1] - h[0]) @ right))

    @scalar("area", "`carried` per switch, on average")
    def carried_per_switch(self) -> float:
        return self.carried / self.time.switches

    @scalar("speed", "pitch times switches per second")
    def wave_speed(self) -> float:
        return self.coils.pitch * self.switching.frequency

    @scalar("speed", "mean speed of the float", when="cargo")
    def float_speed(self) -> float:
        X = self.float_position
        return float((X[-1] - X[0]) / (self.instants[-1] - self.instants[0]))

    @scalar(
        "share",
        "share of switches, after the first few, in which it keeps up with the coils: moves by at "
        "least nine tenths of a pitch",
        when="cargo",
    )
    def float_captured(self) -> float:
        ways = np.diff(self.float_position[:: self.time.samples])[self.switching.on :]
        return float(np.mean(ways >= _KEEPS_UP * self.coils.pitch)) if ways.size else 0.0

    # -- assumptions -------------------------------------------------------------------------------

    @cached_property
    def slopes(self) -> np.ndarray:
        """Sizes of the slopes of the surface, shape (times, cells - 1)."""
        return np.abs(np.diff(self.thickness, axis=1)) / self.layer.step

    @scalar("1", "largest \\|*h*′\\|")
    def slope_max(self) -> float:
        return float(self.slopes.max())

    @scalar("time", "decay time of a ripple of a flat film as long as a block of coils")
    def relaxation_time(self) -> float:
        layer, block = self.layer, self.switching.on * self.coils.pitch
        return -1 / growth_rate(layer.fluid, layer.viscosity, layer.depth, 2 * np.pi / block)

    @scalar("length", "√(γ/ρ*g*)")
    def capillary_length(self) -> float:
        return self.layer.fluid.capillary_length

    @scalar(
        "share",
        "largest share of weight and surface tension that the field across a flat film cancels; "
        "above 1 the film forms peaks (Rosensweig)",
    )
    def normal_field_number(self) -> float:
        layer, flat = self.layer, np.full(self.layer.cells, self.layer.depth)
        across = [
            inside_field(layer.fluid, self.field(flat, now), 0.0 * flat, own_field=True)[2]
            for now in self.currents_of_steps(self.currents.pieces)
        ]
        return normal_field_number(layer.fluid, layer.depth, float(np.abs(across).max()))

    @cached_property
    def inside(self) -> tuple[np.ndarray, np.ndarray]:
        """Field across and along the surface, inside, at all times; (times, cells), A/m."""
        slopes = np.gradient(self.thickness, self.layer.step, axis=1)
        found = [
            inside_field(self.layer.fluid, self.field(z, now), slope, own_field=self.film.own_field)
            for z, slope, now in zip(self.thickness, slopes, self.current, strict=True)
        ]
        along, _, across = zip(*found, strict=True)
        return np.array(across), np.array(along)

    @scalar(
        "share",
        "neglected change of the field by the film's ripples: bound, by first harmonics, of its "
        "share of weight and surface tension",
    )
    def own_field_left_out(self) -> float:
        # The field across reduces stiffness, more for a thicker film. The field along adds
        # stiffness, more for a thinner film. Each one by itself therefore bounds both together.
        fluid, h = self.layer.fluid, self.thickness
        across, along = (float(np.abs(part).max()) for part in self.inside)
        waves = np.pi * np.arange(1, self.layer.cells) / self.layer.length
        taken = field_stiffness(fluid, h.max(), waves, across)
        added = -field_stiffness(fluid, h.min(), waves, 0.0, along)
        restoring = fluid.weight + fluid.surface_tension * waves**2
        return abs(float(np.max(np.maximum(taken, added) / restoring)))  # 0.0, not -0.0

    @scalar("share", "neglected inertia ε*Re*: ρ × flow × slope over the viscosity")
    def inertia(self) -> float:
        inner = np.abs(self.flow[:, 1:-1])
        return float(np.max(self.fluid.density * inner * self.slopes) / self.fluid.viscosity)

    @warnings
    def neglected(self) -> Iterator[str]:
        yield from self.coils.too_hot(self.switching.amount(self.coils))
        for share, words in (
            (
                self.slope_max,
                "slopes of the surface reach {:.2g}; lubrication assumes small slopes",
            ),
            (self.inertia, "inertia is neglected; its share reaches {:.2g}"),
            (
                self.own_field_left_out,
                "the neglected effect of surface ripples on the field is, by first harmonics, up "
                "to {:.2g} of weight and surface tension",
            ),
        ):
            if share > _SMALL:
                yield left_out(share, words.format(share))
        yield from self.warnings_of_float()

    # -- errors ------------------------------------------------------------------------------------

    @check(
        0.1,
        "half the cells change the film by {value:.2g} of its depth; raise grid.cells",
        name="half the cells",
    )
    def off_on_half_the_cells(self) -> float:
        pairs = self.thickness[-1].reshape(-1, 2).mean(axis=1)
        end = self.half_the_cells["thickness"][:, -1]
        return float(np.abs(pairs - end).max() / self.layer.depth)

    @check(
        1e-3,
        "smaller steps change the film by {value:.2g} of its depth; lower grid.tolerance",
        name="smaller steps",
    )
    def off_by_smaller_steps(self) -> float:
        ends = (one["thickness"][:, -1] for one in (self.smaller_steps, self.half_the_cells))
        return float(np.abs(np.subtract(*ends)).max() / self.layer.depth)

    @check(
        1e-6,
        "the field at the surface has an error of {value:.2g}; move the coils from the film",
        name="field",
    )
    def off_in_field(self) -> float:
        worst, largest = 0.0, 1e-300
        for k, now in enumerate(self.currents_of_steps(_SPOTS)):
            z = self.thickness[(k * len(self.thickness)) // _SPOTS]
            known = self.coils.row.field(self.x, self.film.ground + z, now)
            worst = max(worst, float(np.abs(np.array(self.field(z, now)) - known).max()))
            largest = max(largest, float(np.abs(known).max()))
        return worst / largest

    @check(
        1.0,
        "the field across the film cancels {value:.2g} of weight and surface tension: its surface "
        "forms peaks, which are not computed; lower switching.ampere_turns",
    )
    def flat_surface(self) -> float:
        return self.normal_field_number

    @scalar("share", "error of the end state, estimated from half the cells")
    def grid_error(self) -> float:
        return self.off_on_half_the_cells / 3

    @scalar("share", "change of the end state at a tenth of the tolerance")
    def step_error(self) -> float:
        return self.off_by_smaller_steps

    @scalar("share", "largest relative change of the volume")
    def volume_error(self) -> float:
        return self.volume

    @facts
    def effort(self) -> dict[str, Any]:
        return {"steps": self.motion.n_steps, "cells": self.layer.cells}
