"""Runs of kind ``planar-block``: a block slides in the plane until it stops."""

from __future__ import annotations

import math
from time import perf_counter
from typing import Any

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.model import Model
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.planar.body.shape import rigid_shape
from wormopt.systems.planar.dynamics.driven import driven_shape
from wormopt.systems.planar.dynamics.motion import energy_error, measure_works
from wormopt.systems.planar.dynamics.stopping import Stop, stop_of
from wormopt.systems.planar.runs.ground import ground_of
from wormopt.systems.planar.scenes.block import PlanarBlockScene, turned

_AGREED, _ENERGY = 1e-8, 1e-9
_AFTER = 1.1  # simulated time over the time of the stop
_TOLERANCE = Tolerance(1e-12, 1e-13)


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PlanarBlockScene], report: Report) -> Result:
    """Locate the stop as an event and by quadrature; status "failed" if they disagree.

    Raises SolveError if the block does not stop or the motion cannot be followed.
    """
    table, clock = scene.table, perf_counter()
    block = table.block
    law = ground_of(table.ground)
    assert isinstance(law, Elliptic | AnisotropicCoulomb)
    again = stop_of(law, block.mass, turned(block.velocity, -block.heading), table.turned_pull)
    rechecked = perf_counter()
    end = _AFTER * again.time
    motion = simulate(
        measure_works(build_block(table), _energy(table)),
        end,
        times=np.linspace(0.0, end, table.samples),
        tolerance=_TOLERANCE,
        route="radau",  # sideways motion decays quickly, which makes the end stiff
        report=report,
    )
    rests = [event.time for event in motion.events if event.kind == "stick"]
    if not rests:
        raise SolveError(
            "the block does not come to rest", "write a smaller block.pull, or more friction"
        )
    scalars = _scalars(table, motion, rests[-1], again)
    return conclude(
        scene,
        scalars,
        _signals(motion),
        checks=[
            Check(
                "second route", scalars["stop_error"], _AGREED,
                "quadrature finds another stop, so the result is not reliable",
            ),
            Check("energy balance", scalars["energy_error"], _ENERGY, "energy is not balanced"),
        ],
        facts={
            "route": motion.route,
            "recheck": "SciPy's DOP853 in a time in which the stop lies at infinity",
        },
        warnings=motion.warnings,
        timings={"recheck": rechecked - clock, "simulate": perf_counter() - rechecked},
        attributes={
            "heading": block.heading,
            "pull": list(block.pull),
            "forward": law.forward,
            "backward": law.backward,
            "sideways": law.sideways,
        },
    )  # fmt: skip


def models_of(scene: Scene[PlanarBlockScene]) -> dict[str, Model]:
    """Return the model that is simulated."""
    return {"": build_block(scene.table)}


def build_block(table: PlanarBlockScene) -> Model:
    """Return the model of the block: one point, whose inertia only keeps its heading."""
    block, speed = table.block, math.hypot(*table.block.velocity)
    force = max(table.ground.forward, table.ground.sideways or 0.0)
    time = block.mass * speed / force
    return driven_shape(
        rigid_shape([(0.0, 0.0)]),
        mass=block.mass,
        inertia=block.mass * (speed * time) ** 2,
        law=ground_of(table.ground),
        pull=block.pull,
        angle=block.heading,
        velocity=block.velocity,
        length_nominal=speed * time,
        time_nominal=time,
    )


def _energy(table: PlanarBlockScene) -> float:
    return table.block.mass * math.hypot(*table.block.velocity) ** 2 / 2


def _scalars(
    table: PlanarBlockScene, motion: Trajectory, stopped: float, again: Stop
) -> dict[str, Any]:
    x, y = motion["center"][:, -1].tolist()
    other = turned(again.place, table.block.heading)
    size = max(math.hypot(x, y), 1e-12 * math.hypot(*table.block.velocity) * stopped)
    apart = math.hypot(x - other[0], y - other[1]) / size
    path = float(np.hypot(*np.diff(motion["center"], axis=1)).sum())
    moving = motion["center_velocity"][:, motion.time < stopped]
    return {
        "stop_time": stopped,
        "x_stop": x,
        "y_stop": y,
        "distance": math.hypot(x, y),
        "path": path,
        "last_direction": float(np.arctan2(moving[1, -1], moving[0, -1])),
        "friction_work": float(motion["ground_work"][0, -1]),
        "pull_work": float(motion["pull_work"][0, -1]),
        "energy_error": energy_error(motion, "kinetic_energy"),
        "stop_error": max(apart, abs(stopped / again.time - 1)),
        "holding_share": table.holding_share,
        "n_steps": motion.n_steps,
    }


def _signals(motion: Trajectory) -> dict[str, Any]:
    center, velocity, force = (
        motion[name] for name in ("center", "center_velocity", "ground_force")
    )
    return {
        "time": motion.time,
        "x": center[0],
        "y": center[1],
        "x_velocity": velocity[0],
        "y_velocity": velocity[1],
        "friction_x": force[0],
        "friction_y": force[1],
        "kinetic_energy": motion["kinetic_energy"][0],
    }
