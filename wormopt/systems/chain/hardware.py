"""Sensors, actuators and the clock of controllers, declared once for all that are compared."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, on_use, positive
from wormopt.study.types import Seed
from wormopt.systems.chain.tables import DifferenceTracker, Tracker

with on_use():
    import math

    from wormopt.control.hardware import band_limited, through_hardware
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.systems.chain.predictive import limited

# A stretch between two breaks takes milliseconds, a sample a tenth of that.
_MOST_STRETCHES, _MOST_SAMPLES = 1e4, 1e5


class Hardware(Given):
    """Sensors and actuators between controllers and their plant, and the clock of the controllers.

    With a `period` a controller measures and decides at multiples of it, from time 0 on, and its
    input is held until the next (zero-order hold); its own states, such as a gain, follow their
    equations between samples, with the last measurement. Noise is normal at its samples and
    interpolated by cubics, so it has hardly any content above the frequency 1/(2
    `noise_interval`); every plant has its own noise. Measured rates are the derivatives of the
    measured outputs; with `output_step` they are differences of the rounded samples. Inputs in
    open loop are held, limited and rounded too. Not allowed: `input_rate`, `input_step` or
    `output_step` without `period`.

    Examples
    --------
    A controller that decides 100 times per unit of time, with actuators of limited force:

    >>> import wormopt as wo
    >>> worm = wo.chain(1, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0)
    >>> hardware = Hardware(period=0.01, input_limit=6.0)
    >>> plant = hardware.limited(worm)
    >>> aim = wo.gait_reference(wo.Gait([0.0, 1.0], [[[2.5]]]), plant.t)
    >>> loop = hardware.around(plant, wo.lqr(plant, aim, error_weight=1e4), end=2.0)
    >>> motion = wo.simulate(loop, 1.995)
    >>> len(motion.events), float(abs(motion["input"]).max())
    (200, 6.0)
    """

    period: float | None = positive(
        "time", "time between samples; default: controllers act in continuous time", default=None
    )
    input_limit: float | None = positive(
        "force", "upper limit of |*u*<sub>j</sub>|; default: that of the plant", default=None
    )
    input_rate: float | None = positive(
        "",
        "upper limit of |*u*<sub>j</sub>′|, with which actuators approach the input, from 0 on; "
        "default: none",
        default=None,
    )
    input_step: float | None = positive(
        "force", "inputs are rounded to multiples of this step; default: not", default=None
    )
    output_step: float | None = positive(
        "length",
        "measured outputs are rounded to multiples of this step; default: not",
        default=None,
    )
    noise: float = number(
        "length",
        "standard deviation of the noise's samples, for each entry of the output",
        least=0,
        default=0.0,
    )
    noise_interval: float | None = positive(
        "time", "time between samples of the noise; default: `period`", default=None
    )
    delay: float = number("time", "delay of the measurement", least=0, default=0.0)
    seed: Seed = entry("seed of the noise", default=0)

    def faults_of_keys(self) -> Iterator[Fault]:
        for name in ("input_rate", "input_step", "output_step"):
            if getattr(self, name) is not None and self.period is None:
                yield name, "applies to controllers that decide at samples; write a period too"
        if self.noise and self.noise_interval is None and self.period is None:
            yield "noise_interval", "missing; write the time between samples of the noise"

    @property
    def interval(self) -> float:
        """Time between samples of the noise."""
        return self.noise_interval or self.period or 1.0

    @property
    def ideal(self) -> bool:
        """Whether controllers act in continuous time and measure exactly."""
        return self.period is None and not self.noise and not self.delay

    @property
    def words(self) -> str:
        """Description for tables, "" for exact measurements and free inputs."""
        said = {
            "period": "controllers decide every {}",
            "input_limit": "inputs are at most {}",
            "input_rate": "and change at most at {}",
            "input_step": "inputs are multiples of {}",
            "output_step": "measured outputs are multiples of {}",
            "noise": "noise of the measurement is {}",
            "delay": "measurements are late by {}",
        }
        found = [text.format(f"{v:g}") for name, text in said.items() if (v := getattr(self, name))]
        return f"Hardware: {', '.join(found)}." if found else ""

    def limited(self, plant: Model) -> Model:
        """Limit the inputs of a plant, before controllers are made for it.

        Parameters
        ----------
        plant : Model
            A plant with inputs.

        Returns
        -------
        Model
            The plant, with bounds of its inputs where there is an `input_limit`.
        """
        return plant if self.input_limit is None else limited(plant, self.input_limit)

    def noise_of(self, plant: int, end: float, entries: int) -> Gait:
        """Noise over time of the nominal plant, number 0, or of a drawn plant, from 1 on.

        Parameters
        ----------
        plant : int
            Number of the plant.
        end : float
            Last time of the motion.
        entries : int
            Entries of the output.

        Returns
        -------
        Gait
            A row for each entry.
        """
        return band_limited(self.noise, self.interval, end, entries, (self.seed, plant))

    def around(
        self,
        plant: Model,
        loop: Model,
        end: float,
        *,
        output: str = "length",
        input: str = "input",  # noqa: A002
    ) -> Model:
        """Let the controller of a loop measure and act by this hardware.

        Parameters
        ----------
        plant : Model
            The plant around which the loop was closed, as given by `limited`.
        loop : Model
            The closed loop, or the plant driven by inputs over time.
        end : float
            Last time of the motion, until which there is noise.
        output, input : str, optional
            Names of the output that is measured and of the input.

        Returns
        -------
        Model
            The loop with the states ``seen`` (the last measurement), ``held_input`` and
            ``next_sample`` of the clock, if there is one. ``error`` remains that of the plant.

        Raises
        ------
        ArgumentError
            If the measured output is not linear in the plant's states, or a delayed measurement
            meets a controller with delays of its own.
        """
        entries = plant[output].numel()
        return through_hardware(
            plant,
            loop,
            noise=self.noise_of(0, end, entries) if self.noise else None,
            delay=self.delay,
            period=self.period,
            rate=self.input_rate or math.inf,
            output_step=self.output_step or 0.0,
            input_step=self.input_step or 0.0,
            output=output,
            input=input,
        )


def faults_of_hardware(
    hardware: Hardware, end: float, trackers: Sequence[Tracker] = ()
) -> Iterator[Fault]:
    """Yield what is invalid for motions from 0 to `end` with these trackers."""
    lengths = {"period": (hardware.period, _MOST_SAMPLES)}
    lengths["delay"] = hardware.delay, _MOST_STRETCHES
    if hardware.noise:
        lengths["noise_interval"] = hardware.interval, _MOST_STRETCHES
    for name, (length, most) in lengths.items():
        if length and end / length > most:
            cut = f"cuts the time into {end / length:.2g} stretches"
            yield f"hardware.{name}", f"{cut}; write {end / most:g} or more"
    if hardware.delay and any(isinstance(t, DifferenceTracker) for t in trackers):
        message = 'does not apply to feedback = "difference", which has a delay of its own; write 0'
        yield "hardware.delay", message
