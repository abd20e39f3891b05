"""Replays of step commands by counting."""

import csv
import re

import numpy as np
import pytest

from wormopt.model.gait import Gait


def counted(text: str, gait: Gait) -> float:
    """Largest distance to the gait, in microsteps, of lengths that are counted from a table.

    Reads the table with the csv module only; looks on both sides of every step, at turning
    points found by dense sampling, and at many other instants.
    """
    head = dict(re.findall(r"^# (\w+): (.*)$", text, re.MULTILINE))
    travel, period = float(head["travel_m"]), float(head["period_s"])
    start = [float(v) for v in head["length_at_start_m"].split(",")]
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    worst = 0.0
    for j in range(len(start)):
        own = [row for row in rows if int(row["motor"]) == j]
        times = np.array([float(row["time_s"]) for row in own])
        place = start[j] + travel * np.cumsum([0] + [int(row["direction"]) for row in own])
        t = np.linspace(0, period, 4001)[:-1]
        assert np.all(np.diff(times) >= 0)
        before = np.searchsorted(times, [*times, *t], side="left")
        after = np.searchsorted(times, [*times, *t], side="right")
        # at the very end of the period the gait is where it began
        ideal = gait(np.concatenate([np.minimum(times, np.nextafter(period, 0)), t]))[j]
        worst = max(worst, np.abs(ideal - place[before]).max(), np.abs(ideal - place[after]).max())
        assert place[-1] == pytest.approx(start[j], abs=1e-9)
    return worst / travel
