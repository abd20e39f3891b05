"""MuJoCo: a worm as MJCF, with the targets of its joints as keyframes.

On a line, friction is the `frictionloss` of a tendon as long as the position of a mass. Friction
F+ ahead and F- back is exactly one of (F+ + F-)/2 to both sides and a constant push of
(F- - F+)/2, and a spike has a large F-. In the plane each mass has a foot that a spring
presses on the floor. A contact in MuJoCo lifts a body in proportion to its coefficient of friction,
so the press is large, and the foot is heavy, but only upward.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.exports.robot import DIFFERS, Robot

_SERVO = 0.3  # natural frequency of a servo times the step
_ROTOR = 1.0  # inertia of a drive over force times cycle² over length
_FIRM = "0.9999 0.9999 0.001 0.5 2"  # the hardest constraint that MuJoCo allows
_PRESS = 1e3  # of a foot, over its friction
_FALL = 100.0  # acceleration of a foot by that, over length and cycle²
_SLIGHT = 1e-6  # inertia of a mass over mass times length², and share of its mass off the foot
_THICK, _SHORT = 0.05, 1e-3  # radius of a foot and half its length, over the length of a link
_MOST = 100_000  # steps of a cycle
_SHARE = {"rear": 0.0, "bisector": 0.5, "front": 1.0}  # of a joint angle in the heading of a mass


def make(robot: Robot, stem: str, step: float = 0.001) -> dict[str, bytes]:
    """``STEM.xml``: the worm, with one keyframe for each step of a cycle.

    The step is the largest one of at most `step` that divides the cycle.
    """
    steps = steps_of(robot, step)
    step = robot.cycle / steps
    notes = list(robot.notes)
    if robot.hold:
        notes.append(f"a spike holds {robot.hold:.4g} N, twice the bound of what this gait needs")
    if robot.massless:
        notes.append(f"each mass is {robot.mass[0]:.4g} kg, but 0 in the scene")
    root = Element("mujoco", model=robot.name)
    how = {"integrator": "implicitfast", "cone": "elliptic", "tolerance": "1e-14"}
    how["impratio"] = "1" if robot.massless else "100"  # hard friction; light feet would slip
    add(root, "option", timestep=step, gravity=(0.0 - robot.fall, 0, 0), iterations="200", **how)
    parent = add(root, "worldbody")
    add(parent, "geom", name="floor", type="plane", size=(0, 0, 1), contype="0", conaffinity="0")
    for i in range(len(robot.mass)):
        parent = _mass(robot, parent, i)
    firm = {"solref": (2 * step, 1), "solimp": _FIRM}  # MuJoCo takes 2 steps at least
    (_feet if robot.planar else _ground)(robot, root, firm)
    _keys(robot, root, _actuators(robot, root, step), steps)
    return {f"{stem}.xml": written(root, robot, notes)}


def add(
    parent: Element, tag: str, text: str = "", **attributes: str | float | Sequence[float]
) -> Element:
    """Add an element; numbers in its attributes are exact."""
    words = {k: v if isinstance(v, str) else " ".join(map(repr, np.ravel(v).astype(float).tolist()))
             for k, v in attributes.items()}  # fmt: skip
    found = ElementTree.SubElement(parent, tag, words)
    found.text = text or None
    return found


def written(root: Element, robot: Robot, notes: Iterable[str]) -> bytes:
    """Text of a document, with remarks on its origin and on what differs from the scene."""
    text = "\n".join(("", *robot.remarks, *(f"{DIFFERS} {note}." for note in notes), ""))
    root.insert(0, ElementTree.Comment(text.replace("--", "- -")))
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, "utf-8") + b"\n"


def steps_of(robot: Robot, step: float) -> int:
    """Steps of a cycle, each at most `step` long."""
    if not step > 0:
        raise ArgumentError(f"the step must be positive, not {step!r}")
    steps = max(3, math.ceil(robot.cycle / step * (1 - 1e-12)))
    if steps > _MOST:
        raise ArgumentError(
            f"a step of {step:g} gives {steps} in a cycle, more than {_MOST}; write a step of at "
            f"least {robot.cycle / _MOST:.3g}"
        )
    return steps


# -- bodies ----------------------------------------------------------------------------------------


def _mass(robot: Robot, parent: Element, i: int) -> Element:
    """Body of mass i, which carries all masses behind it."""
    size, mass = robot.size, float(robot.mass[i])
    away = robot.lengths[i - 1] if i and robot.lengths else 0.0
    body = add(parent, "body", name=f"mass_{i}", pos=(0.0 - away, 0, 0))
    if i == 0:
        roots = (("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("yaw", "hinge", "0 0 1"))
        for name, kind, axis in roots if robot.planar else roots[:1]:
            add(body, "joint", name=name, type=kind, axis=axis)
    for name, kind, axis in (
        (f"link_{i - 1}", "slide", "-1 0 0"),
        (f"joint_{i - 1}", "hinge", "0 0 -1"),
    ):
        if name in robot.joints:
            drive: dict[str, Any] = {"armature": _rotor(robot, name)}
            if robot.elastic is not None:
                drive = {"damping": robot.elastic[1, robot.joints.index(name)]}
            add(body, "joint", name=name, type=kind, axis=axis, **drive)
    at: dict[str, Any] = {"pos": (0, 0, 0), "diaginertia": [_SLIGHT * mass * size**2] * 3}
    here = mass * _SLIGHT if robot.planar else mass
    add(body, "inertial", mass=here, **at)
    look = {"pos": (0, 0, _THICK * size), "contype": "0", "conaffinity": "0"}
    if not robot.planar:
        add(body, "geom", type="sphere", size=_THICK * size, **look)
        return body
    foot, press = add(body, "body", name=f"foot_{i}"), _press(robot, i)
    spring: dict[str, Any] = {"stiffness": press / size, "springref": -size}
    heavy = press * robot.cycle**2 / (_FALL * size)
    add(foot, "joint", name=f"foot_{i}", type="slide", axis="0 0 1", armature=heavy, **spring)
    if 0 < i < robot.links and _SHARE[robot.heading]:
        add(foot, "joint", name=f"heading_{i}", type="hinge", axis="0 0 1")
    add(foot, "inertial", mass=mass - here, **at)
    # contacts of a capsule, unlike those of a sphere, have friction along and across it
    lying = {"type": "capsule", "euler": "0 90 0", "size": (_THICK * size, _SHORT * size)}
    add(foot, "geom", name=f"foot_{i}", **lying, **look)
    add(foot, "site", name=f"foot_{i}")
    return body


def _press(robot: Robot, i: int) -> float:
    return _PRESS * max(robot.grips[i])


def _rotor(robot: Robot, joint: str) -> float:
    """Inertia of a joint's drive."""
    # It moves no mass on the ground if the joint follows its targets, and the heavier it is, the
    # stiffer a servo may be.
    force = sum(map(max, robot.grips)) + np.abs(robot.load).sum()
    inertia = _ROTOR * (force or robot.mass.sum() * robot.size / robot.cycle**2) * robot.cycle**2
    return float(inertia / robot.size if joint.startswith("link") else inertia * robot.size)


# -- ground and actuators --------------------------------------------------------------------------


def _ground(robot: Robot, root: Element, firm: dict[str, Any]) -> None:
    """Friction and drag on a line, of tendons as long as the position of a mass."""
    tendons = add(root, "tendon")
    for i, (ahead, back, _) in enumerate(robot.grips):
        own: dict[str, Any] = {"damping": robot.drag[i]}
        if ahead + back:
            own |= {f"{key}friction": value for key, value in firm.items()}
            own["frictionloss"] = (ahead + back) / 2
        tendon = add(tendons, "fixed", name=f"ground_{i}", **own)
        add(tendon, "joint", joint="x", coef="1")
        for j in range(i):
            add(tendon, "joint", joint=f"link_{j}", coef="-1")


def _feet(robot: Robot, root: Element, firm: dict[str, Any]) -> None:
    """Friction in the plane, and the headings of inner masses."""
    pairs, bonds = add(root, "contact"), add(root, "equality")
    for i, (ahead, back, aside) in enumerate(robot.grips):
        friction = np.array([(ahead + back) / 2, aside, 0, 0, 0]) / _press(robot, i)
        both = {"geom1": "floor", "geom2": f"foot_{i}", "condim": "3"}
        add(pairs, "pair", name=f"ground_{i}", friction=friction.tolist(), **both, **firm)
        share = _SHARE[robot.heading]
        if 0 < i < robot.links and share:
            both = {"joint1": f"heading_{i}", "joint2": f"joint_{i - 1}"}
            add(bonds, "joint", polycoef=(0, share, 0, 0, 0), **both, **firm)


def _actuators(robot: Robot, root: Element, step: float) -> int:
    """Actuators and their number."""
    actuators = add(root, "actuator")
    rotors = np.array([_rotor(robot, name) for name in robot.joints])
    stiffness = rotors * (_SERVO / step) ** 2 if robot.elastic is None else robot.elastic[0]
    for name, firm in zip(robot.joints, stiffness.tolist(), strict=True):
        add(actuators, "position", name=name, joint=name, kp=firm)
    if robot.elastic is None:
        for name, rotor in zip(robot.joints, rotors.tolist(), strict=True):
            add(
                actuators, "velocity", name=f"{name}_rate", joint=name, kv=2 * rotor * _SERVO / step
            )
    constant = {"gainprm": "0", "biastype": "affine"}
    for i, (ahead, back, _) in enumerate(robot.grips):
        at = (
            {"site": f"foot_{i}", "gear": "1 0 0 0 0 0"}
            if robot.planar
            else {"tendon": f"ground_{i}"}
        )
        if force := (back - ahead) / 2 - robot.load[i]:
            add(actuators, "general", name=f"push_{i}", biasprm=force, **at, **constant)
    if any(robot.trailed):
        ahead, left, moment = robot.trailed
        at = {"site": "foot_0", "gear": (ahead, left, 0, 0, 0, moment)}
        add(actuators, "general", name="load", biasprm="1", **at, **constant)
    return len(actuators)


# -- keyframes -------------------------------------------------------------------------------------


def _keys(robot: Robot, root: Element, controls: int, steps: int) -> None:
    """A keyframe for each step; the first one is the start."""
    # Targets of positions are those of the step's begin and those of rates of its end, because
    # MuJoCo takes springs at the begin and damping at the end.
    times, value, rate = robot.table(steps)
    rows = value[:-1] if robot.elastic is not None else np.hstack([value[:-1], rate[1:]])
    rows = np.pad(rows, ((0, 0), (0, controls - rows.shape[1])))
    keys = add(root, "keyframe")
    begin = robot.begin if robot.begin is not None else np.array([value[0], rate[0]])
    place, speed = (_whole(robot, *two) for two in zip(robot.root, begin, strict=True))
    add(keys, "key", time=0.0, ctrl=rows[0].tolist(), qpos=place, qvel=speed)
    for t, row in zip(times[1:steps].tolist(), rows[1:].tolist(), strict=True):
        add(keys, "key", time=t, ctrl=row)


def _whole(robot: Robot, root: np.ndarray, row: np.ndarray) -> list[float]:
    """Values of all joints in the order of the bodies, from those of the root and of targets."""
    if not robot.planar:
        return [root[0], *row]
    share, by_name = _SHARE[robot.heading], dict(zip(robot.joints, row, strict=True))
    found = [*root, 0.0]  # a foot after each mass
    for i in range(1, robot.links + 1):
        found += [by_name[name] for name in (f"link_{i - 1}", f"joint_{i - 1}") if name in by_name]
        found += [0.0, share * by_name[f"joint_{i - 1}"]] if i < robot.links and share else [0.0]
    return found
