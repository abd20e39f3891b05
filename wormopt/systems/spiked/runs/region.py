"""The map over period and load of where kinematics determines a gait, checked by simulation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wormopt.errors import SolveError
from wormopt.result import Check
from wormopt.simulation.simulate import simulate
from wormopt.systems.spiked.crawl import Crawl
from wormopt.systems.spiked.driven import driven_worm
from wormopt.systems.spiked.region import Region
from wormopt.systems.spiked.runs.motion import Findings
from wormopt.systems.spiked.scenes.gait import RegionTable
from wormopt.systems.spiked.stretches import Drive

_PERIODS, _LOADS = 121, 81
_CHECKED = 4  # periods at which both sides of the border are simulated
_ASIDE = (0.01, 0.1)  # distance from the border, as shares of its load
_MOVES, _LOAD_OFF = 1e-7, 1e-6  # glides slower than this share of the rates are rounding


def mapped(table: RegionTable, motion: Crawl) -> Findings:
    """Compute the map and its checks. Raises SolveError where velocities jump."""
    drive, region = motion.drive, Region(motion.drive)
    if motion.corners:
        raise SolveError(
            "the gait has corners; there forces are impulses at every period and load, so the "
            "region is undefined",
            "smooth its corners (a `ramp`, another `profile`), or remove `region` from `want`",
        )
    period = drive.gait.period
    most = 2 * max(drive.load, region.least_load(period), 0.0) or drive.force_scale
    first, last = table.periods or (period / 2, 2 * period)
    lightest, heaviest = table.loads or (0.0, most)
    periods, loads = np.linspace(first, last, _PERIODS), np.linspace(lightest, heaviest, _LOADS)
    least = np.array([region.least_load(t) for t in periods])
    peaks = np.array([region.spike_loads(t, loads) for t in periods])
    variables = {
        "region_period": periods,
        "region_load": loads,
        "region_spike_load": np.where(loads >= least[:, None], peaks, np.nan),
        "region_least_load": least,
    }
    if table.spike_load is not None:
        breaks = [region.most_load(t, table.spike_load) for t in periods]
        variables["region_most_load"] = np.array(breaks)
    scalars = {"region_gait_load": drive.load, "region_spike_strength": table.spike_load}
    return Findings(scalars, variables, tuple(_checks(region, periods)))


def _checks(region: Region, periods: np.ndarray) -> Iterator[Check]:
    """Simulate the dynamics at random periods with loads on both sides of the border."""
    numbers, wrong, off = np.random.default_rng(0), 0, 0.0
    for period in numbers.uniform(periods[0], periods[-1], _CHECKED):
        border = region.least_load(period)
        for side in (-1, 1):
            load = border * (1 + side * numbers.uniform(*_ASIDE))
            if border <= 0:  # no load is needed: there is one side only
                load = numbers.uniform(0.0, region.drive.force_scale)
            glides, total = _simulated(region.drive, period, load)
            wrong += glides != (load < border)
            if not glides:
                off = max(off, abs(total / region.total_load(period, load) - 1))
    advice = "the simulated worm glides where the map predicts no gliding, or vice versa"
    yield Check("sides of the border, simulated", wrong, 0, advice)
    advice = "the simulated spike loads differ from those of the map"
    yield Check("loads of the map, simulated", off, _LOAD_OFF, advice)


def _simulated(drive: Drive, period: float, load: float) -> tuple[bool, float]:
    """Whether the worm glides in a period, and the largest load on all spikes together."""
    gait = drive.gait.with_period(period)
    worm = driven_worm(gait, drive.mass.tolist(), drive.drag, load)
    motion = simulate(worm, period, times=np.linspace(0.0, period, 401), dense=True)
    slow = _MOVES * drive.rate_scale * drive.gait.period / period
    return bool(motion["glide"].max() > slow), motion.largest("spike_load")
