"""Tables ``[predictive]``, ``[estimation]`` and ``[plants]`` of predictive control."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, positive, whole
from wormopt.study.types import Seed
from wormopt.systems.chain.tables import ChainTable, Share

Estimated = Literal["mass", "stiffness", "damping", "friction_forward", "friction_backward"]
ESTIMATED: tuple[Estimated, ...] = ("mass", "friction_forward", "friction_backward")


class PlantsTable(Given):
    """Plants with drawn parameters.

    Each parameter is drawn independently from a uniform distribution around its nominal value.
    """

    members: int = whole(1, 1000, "number of drawn plants")
    spread: Share = entry(
        "every mass, stiffness, damping and friction force is drawn within ± this share",
        quantity="share",
    )
    seed: Seed = entry("seed of the drawn plants", default=0)


class PredictiveTable(Given):
    """Predictive control of ∫(|*e*|² + *ρ*|*u*|²) d*t*, with a new decision every `period`.

    The controller's model has the smooth law of friction. Its terminal cost is, to second order,
    the cost of a deviation from the plan for the whole motion.
    """

    period: float = positive(
        "time", "longest time between decisions; it is shorter before a corner of the reference"
    )
    horizon: float = positive("time", "prediction horizon")
    input_weight: float = positive("", "*ρ*")
    v_reg: float = positive(
        "speed", "width of velocities over which the model's friction law is steep"
    )
    steps: int = whole(
        1,
        1000,
        "upper limit of the solver steps per decision of the converged controller; the "
        "real-time controller makes one step",
        default=20,
    )
    force: float | None = positive(
        "force", "upper limit of |*u*<sub>j</sub>|; default: no limit", default=None
    )
    seconds: float = positive(
        "s",
        "seconds per unit of the scene's time, to which the duration of decisions is "
        "compared; 1 with SI units",
        default=1.0,
    )

    def faults(self, end: float, units: str) -> Iterator[Fault]:
        """Yield what is invalid for a motion from 0 to `end`."""
        if self.horizon < self.period:
            yield "predictive.horizon", f"is below predictive.period = {self.period:g}; write more"
        if self.period > end:
            yield "predictive.period", f"is above time.end = {end:g}; write less"
        if end / self.period > _MOST:
            least = end / _MOST
            yield "predictive.period", f"makes over {_MOST} decisions; write at least {least:.3g}"
        if units == "SI" and self.seconds != 1.0:
            yield "predictive.seconds", "is 1 with SI units; leave it out"


_MOST = 20_000


class EstimationTable(Given):
    """Moving-horizon estimation of the parameters that explain the recent motion best.

    States are measured at every decision. The parameters of each link and each mass are estimated
    separately. The estimate minimises the squared residuals of the measurements in the window plus
    the squared logarithmic deviations of the parameters from their prior. Measurements that leave
    the window update the prior.
    """

    parameters: tuple[Estimated, ...] = entry(
        "parameters to estimate; the others keep the model's values", default=ESTIMATED
    )
    window: float = positive("time", "length of the window")
    noise: float = positive(
        "share", "standard deviation of a measured state, in usual sizes", default=0.01
    )
    spread: float = positive("share", "standard deviation of a parameter's prior", default=0.2)
    memory: float | None = positive(
        "time",
        "time after which the information of past measurements decays to 1/e; default: no decay",
        default=None,
    )

    def faults(self, worm: ChainTable) -> Iterator[Fault]:
        """Yield conflicts between the keys, and parameters that this chain does not have."""
        if not self.parameters:
            yield "estimation.parameters", "names no parameter; leave [estimation] out"
        if len(set(self.parameters)) < len(self.parameters):
            yield "estimation.parameters", "names a parameter twice; write each once"
        for name in self.parameters:  # The estimate is of logarithms.
            if not all(value > 0 for value in _values(worm, name)):
                yield (
                    "estimation.parameters",
                    f"contains {name}, which is not above 0 in this worm; leave it out",
                )


def _values(worm: ChainTable, name: str) -> Iterator[float]:
    """Values of a parameter, or a single 0 if the worm does not have it."""
    side = name.removeprefix("friction_")
    given = [getattr(worm, name)] if side == name else [getattr(g, side, 0.0) for g in worm.ground]
    for each in given or [0.0]:
        yield from each if isinstance(each, tuple) else (each,)
