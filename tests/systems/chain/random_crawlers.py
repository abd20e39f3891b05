"""Random robots of two to five links in SI, from micrometres and milligrams to metres and kg."""

from __future__ import annotations

from typing import Any

import numpy as np


def random_crawler(seed: int) -> dict[str, Any]:
    """Tables of a scene: a chain, its limits, an objective."""
    dice = np.random.default_rng([63, seed])
    links = 2 + seed % 4
    rest, mass, pace = (10 ** dice.uniform(*ends) for ends in ((-5, 0), (-6, 0), (0, 1.5)))
    swing, omega = 0.25 * rest, 2 * np.pi * pace
    stiffness = mass * omega**2
    force = dice.uniform(1, 4) * stiffness * swing
    forward = dice.uniform(0.02, 0.1) * force
    worm = {
        "links": links,
        "mass": (mass * dice.uniform(0.6, 1.6, links + 1)).tolist(),
        "stiffness": (stiffness * dice.uniform(0.7, 1.4, links)).tolist(),
        "damping": 2 * dice.uniform(0.2, 1.0) * mass * omega,
        "rest_length": rest,
        "load": (forward * dice.uniform(-0.5, 1.0, links + 1)).tolist(),
        "friction": {
            "kind": "coulomb",
            "forward": forward,
            "backward": forward * dice.uniform(3, 20),
        },
    }
    limits: dict[str, Any] = {
        "period": [0.5 / pace, 4 / pace] if seed % 3 else 1 / pace,
        "actuator_force": force,
        "length": [rest - swing, rest + swing],
    }
    if seed % 5 == 1:
        limits["rate"] = dice.uniform(0.5, 2) * swing * omega
    if seed % 5 == 2:
        limits["acceleration"] = dice.uniform(1, 3) * swing * omega**2
    if seed % 5 == 3:
        limits["actuator_power"] = dice.uniform(0.2, 1) * force * swing * omega
    effort = 0.02 * swing * omega / force**2 if seed % 2 else 0.0
    return {
        "schema": 1,
        "kind": "optimal-crawl",
        "units": "SI",
        "worm": worm,
        "limits": limits,
        "objective": {"maximise": "speed", "effort": effort},
    }
