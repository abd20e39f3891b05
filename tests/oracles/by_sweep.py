"""A sweep as its folder holds it, made by hand of small scenes."""

from pathlib import Path

import numpy as np

import wormopt as wo
from wormopt.quantities import Variable
from wormopt.result import Result

LOADS, ELONGATIONS = (5.0, 10.0, 20.0), (0.1, 0.15, 0.2)
# Points that are not ok: 1 failed, 2 refused, 3 not computed.
BAD = {(2, 2): 1, (0, 2): 2, (2, 0): 3}


def make_sweep(folder: Path) -> Path:
    """Run the points of a grid and save them with what they give together."""
    shape = (len(LOADS), len(ELONGATIONS))
    speed, largest = np.full(shape, np.nan), np.full(shape, np.nan)
    status, points, reasons = np.zeros(shape, int), [], []
    for at in np.ndindex(*shape):
        status[at] = BAD.get(at, 0)
        if status[at] > 1:
            points.append(None)
            reasons.append("gait.elongation: too much" if status[at] == 2 else "")
            continue
        changes = [f"worm.load={LOADS[at[0]]}", f"gait.elongation={ELONGATIONS[at[1]]}"]
        result = wo.run(wo.load_scene("fast_gait", changes))
        if status[at]:
            result = result.failed("the check failed")
        name = f"{at[0]}-{at[1]}.nc"
        (folder / "points").mkdir(exist_ok=True)
        result.save(folder / "points")
        (folder / "points" / "result.nc").rename(folder / "points" / name)
        (folder / "points" / "summary.json").unlink()
        points.append(name)
        reasons.append(result.reason)
        speed[at] = result.scalars["speed"].value
        largest[at] = result.scalars["spike_load_max"].value
    dims = ("load", "elongation")
    Result(
        "loads",
        "sweep",
        title="Speed over load and elongation",
        variables=(
            Variable("load", "1", ("load",), np.array(LOADS), "worm.load"),
            Variable("elongation", "1", ("elongation",), np.array(ELONGATIONS), "gait.elongation"),
            Variable("speed", "1", dims, speed, "mean speed"),
            Variable("spike_load_max", "1", dims, largest, "largest load of a single spike"),
            Variable("status", "1", dims, status),
            Variable("seconds", "s", dims, np.full(shape, 0.1), "time that it took"),
        ),
        scene_text=wo.load_scene("fast_gait").text,
        attributes={
            "kind": "gait",
            "units": "dimensionless",
            "numbers": ["speed", "spike_load_max"],
            "axes": [
                {"key": "worm.load", "dim": "load", "values": LOADS},
                {"key": "gait.elongation", "dim": "elongation", "values": ELONGATIONS},
            ],
            "files": points,
            "reasons": reasons,
        },
    ).save(folder)
    return folder
