"""Search words that scenes and kinds do not use, with the words that they use instead."""

from __future__ import annotations

import re

SYNONYMS: dict[str, str] = {
    "adaptive": "tracker",
    "bang-bang": "slide minimum",
    "calibrate": "fit estimate",
    "capsubot": "capsule",
    "caterpillar": "peristaltic",
    "certificate": "certified bound",
    "control": "track tracker LQR linear",
    "controller": "track tracker LQR linear",
    "conveyor": "cargo float",
    "data": "recording measured",
    "earthworm": "peristaltic",
    "elastomer": "elastic membrane rubber",
    "electromagnet": "coil",
    "endoscope": "capsule channel tube",
    "estimation": "estimate fit",
    "ferrofluid": "film fluid",
    "hardware": "stepper stepping",
    "hill": "uphill slope",
    "identification": "estimate fit identify identifies",
    "identify": "estimate fit identifies",
    "impact": "capsule",
    "inchworm": "spiked peristaltic",
    "incline": "slope uphill hill",
    "leech": "peristaltic",
    "limbless": "planar",
    "lqr": "predictive",
    "measurement": "measured recording",
    "motor": "stepper",
    "mpc": "predictive",
    "navigation": "path",
    "obstacle": "path",
    "optimal": "optimise design fastest best",
    "optimisation": "optimise optimal design fastest best",
    "optimise": "optimal design fastest best",
    "optimization": "optimise optimal design fastest best",
    "optimize": "optimise optimal design fastest best",
    "parameter": "fit",
    "peristalsis": "peristaltic",
    "pipe": "tube channel",
    "planning": "plan path",
    "power": "cheapest energy work",
    "pump": "flow",
    "robust": "random errors fitted",
    "rotate": "turn turning",
    "serpentine": "serpenoid planar",
    "setae": "spike spiked",
    "silicone": "membrane elastic rubber",
    "simulation": "simulate",
    "slope": "uphill hill",
    "snake": "planar serpenoid",
    "soft": "peristaltic membrane elastic",
    "solenoid": "coil",
    "steer": "turn turning",
    "swimming": "swim viscous",
    "time-optimal": "fastest minimum",
    "tracking": "track",
    "trade-off": "pareto",
    "transport": "cargo float",
    "undulation": "serpenoid swim",
    "vibration": "resonance oscillations capsule",
}
"""A word to search for, and the words of scenes and kinds that mean the same."""


def has_all(words: list[str], text: str) -> bool:
    """Return whether a text contains each of some words, or a synonym at the start of a word."""
    text = text.casefold()

    def has(word: str) -> bool:
        meant = "|".join(SYNONYMS.get(word, "").casefold().split())
        return word in text or bool(meant and re.search(rf"(?<![a-z])({meant})", text))

    return all(has(word.casefold()) for word in words)
