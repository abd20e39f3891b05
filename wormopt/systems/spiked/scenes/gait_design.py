"""Scenes of kind "gait-pareto": optimal gaits within limits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, whole
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.spiked.declared import DESIGN_SCALARS, MOTION_VARIABLES
from wormopt.systems.spiked.design_tables import COST_WORDS, DesignTable
from wormopt.systems.spiked.task import Cost


class ParetoTable(Given):
    """The Pareto front to compute."""

    against: Cost = entry(f"the cost to trade against speed: {COST_WORDS}")
    points: int = whole(
        3,
        50,
        "number of designed gaits: the fastest, and the cheapest at equidistant lower speeds",
        default=9,
    )


class GaitParetoScene(DesignTable):
    """The Pareto front of optimal gaits between speed and a cost.

    Kind [`gait-design`](gait-design.md) explains `[gait]`, `[search]`, `[motor]` and the trust
    report. All points are searched with the same effort. Each point tries the resting sequence of
    the previous point first. `search.time_limit` applies to each point.

    Refused: costs that are refused in `[objective]` of a design; `[search.certify]`.

    Points are numbered from 0, the slowest. The front is printed as a table, which is also in
    `table.md`. The table gives the cost of each point, its resting masses in order, the limits that
    bind, and the knee of the front. It also marks points whose resting sequence differs from that
    of the point before. There the front jumps, and the picture `front` draws no line.

    The gait of every point is saved. Load it with `load_gait(path, point=2)` in Python, or with
    `file = "result.nc"` and `point = 2` in a scene. Signals, the trust report and all scalars
    except those of the front belong to the gait at the knee. In the trust report, `dominated` is
    the number of points that a faster gait dominates. Its warnings include those of other points
    and list points for which no gait was found. The cost is also a scalar (`spike_load_max`,
    `actuator_force_max`, `energy_per_distance` or `acceleration_effort`), and `front_value` has its
    quantity. Timing: `front`.
    """

    headline: ClassVar = (
        "front_objective",
        "front_points",
        "speed_max",
        "speed",
        "period",
        "mode_sequence",
    )
    scalars: ClassVar = DESIGN_SCALARS | {
        "acceleration_effort": ("acceleration_squared", "acceleration effort, if it is the cost"),
        "front_objective": ("1", "the cost, as given in `pareto.against`"),
        "front_points": ("count", "number of points on the front"),
        "front_knee": ("count", "index of the knee; points are numbered from 0, the slowest"),
        "front_jumps": (
            "count",
            "neighbouring points on the front with different resting sequences",
        ),
        "front_speeds": ("speed", "mean speed of each point"),
        "front_values": ("force", "cost of each point, in its quantity"),
        "front_counted": ("1", "whether each point is on the front: accepted and not dominated"),
        "front_sequences": ("count", "resting masses of each point, phase by phase"),
        "front_resting": ("count", "smallest number of resting masses of each point"),
        "front_binding": ("1", "limits of `[gait]` that bind at each point"),
        "speed_max": ("speed", "mean speed of the fastest gait"),
    }
    variables: ClassVar = {
        **MOTION_VARIABLES,
        **GAIT,
        "front_speed": ("speed", ("point",), "mean speed"),
        "front_value": ("force", ("point",), "cost"),
        "front_accepted": ("1", ("point",), "1 if the point is on the front"),
        "front_order": ("count", ("point",), "number that identifies the resting sequence"),
        "front_gait_breaks": (
            "time",
            ("point", "front_gait_break"),
            "times at which pieces of the point's gait begin, NaN after the last",
        ),
        "front_gait_polynomial": (
            "length",
            ("point", "front_gait_piece", "link", "front_gait_power"),
            "coefficients of s^k, s the time since the piece began, NaN after the last piece",
        ),
    }

    kind: Literal["gait-pareto"]
    want: tuple[Literal["front", "gait", "motion", "spikes"], ...] = entry(
        "`front`: the front; `gait`, `motion`, `spikes`: the gait at its knee", default=()
    )
    pareto: ParetoTable = entry("the front")

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield the faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.faults_of_cost("pareto.against", self.pareto.against)
        if self.search.certify is not None:
            yield (
                "search.certify",
                "a front has no certificate; remove the table and certify single gaits in scenes "
                'of kind = "gait-design"',
            )
