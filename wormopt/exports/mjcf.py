"""MuJoCo: a worm as MJCF, with the targets of its joints as keyframes.

On a line, friction is the `frictionloss` of a tendon as long as the position of a mass. Friction
F+ ahead and F- back is exactly one of (F+ + F-)/2 to both sides and a constant push of
(F- - F+)/2, and a spike has a large F-. In the plane each mass stands on a foot that a spring
presses on the floor. A contact in MuJoCo lifts a body in proportion to its coefficient of friction,
so the press is large, and the foot is heavy, but only upward.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

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


def make(robot: Robot, stem: str, step: float = 0.001) -> dict[str, bytes]:
    """``STEM.xml``: the worm, with one keyframe for each step of a cycle.

    The step is the largest one of at most `step` that divides the cycle. Raises
    ArgumentError if it is not positive or gives too many keyframes.
    """
    return {f"{stem}.xml": written(_model(robot, steps_of(robot, step)), robot, _notes(robot))}


def _notes(robot: Robot) -> tuple[str, ...]:
    found = list(robot.notes)
    if robot.hold:
        found.append(f"a spike holds {robot.hold:.4g} N, twice the bound of what this gait needs")
    if robot.massless:
        found.append(f"each mass is {robot.mass[0]:.4g} kg, light beside its friction, and 0 there")
    return tuple(found)


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


def xml(*values: float) -> str:
    """Numbers of an attribute, exact."""
    return " ".join(repr(float(value)) for value in values)


def _model(robot: Robot, steps: int) -> Element:
    step = robot.cycle / steps
    soft = xml(2 * step, 1.0)  # no constraint may be faster
    root = Element("mujoco", model=robot.name)
    SubElement(
        root,
        "option",
        timestep=xml(step),
        gravity=xml(0.0 - robot.fall, 0, 0),
        cone="elliptic",
        integrator="implicitfast",
        tolerance="1e-14",
        iterations="200",
        ls_iterations="200",
    )
    world = SubElement(root, "worldbody")
    SubElement(
        world, "geom", name="floor", type="plane", size="0 0 1", contype="0", conaffinity="0"
    )
    parent = world
    for i in range(len(robot.mass)):
        parent = _mass(robot, parent, i)
    if robot.planar:
        _feet(robot, root, soft)
    else:
        _ground(robot, root, soft)
    actuators = SubElement(root, "actuator")
    _drives(robot, actuators, step)
    _pushes(robot, actuators)
    _keys(robot, root, len(actuators), steps)
    return root


# -- bodies ----------------------------------------------------------------------------------------


def _mass(robot: Robot, parent: Element, i: int) -> Element:
    """Body of mass i, which carries all masses behind it."""
    size, n = robot.size, robot.links
    away = robot.lengths[i - 1] if i and robot.lengths else 0.0
    body = SubElement(parent, "body", name=f"mass_{i}", pos=xml(0.0 - away, 0, 0))
    if i == 0:
        for name, axis in (("x", "1 0 0"), ("y", "0 1 0"))[: 2 if robot.planar else 1]:
            SubElement(body, "joint", name=name, type="slide", axis=axis)
        if robot.planar:
            SubElement(body, "joint", name="yaw", type="hinge", axis="0 0 1")
    for name, kind, axis in (
        (f"link_{i - 1}", "slide", "-1 0 0"),
        (f"joint_{i - 1}", "hinge", "0 0 -1"),
    ):
        if name in robot.joints:
            joint = SubElement(body, "joint", name=name, type=kind, axis=axis)
            if robot.elastic is None:
                joint.set("armature", xml(_rotor(robot, name)))
            else:
                joint.set("damping", xml(robot.elastic[1, robot.joints.index(name)]))
    mass, turn = robot.mass[i], xml(*3 * [_SLIGHT * robot.mass[i] * size**2])
    here = mass * _SLIGHT if robot.planar else mass
    SubElement(body, "inertial", pos="0 0 0", mass=xml(here), diaginertia=turn)
    radius = xml(_THICK * size)
    if not robot.planar:
        shape = {"type": "sphere", "size": radius, "contype": "0", "conaffinity": "0"}
        SubElement(body, "geom", pos=f"0 0 {radius}", **shape)
        return body
    foot = SubElement(body, "body", name=f"foot_{i}")
    press = _press(robot, i)
    heavy = press * robot.cycle**2 / (_FALL * size)
    SubElement(
        foot,
        "joint",
        name=f"foot_{i}",
        type="slide",
        axis="0 0 1",
        armature=xml(heavy),
        stiffness=xml(press / size),
        springref=xml(-size),
    )
    if 0 < i < n and robot.heading != "rear":
        SubElement(foot, "joint", name=f"heading_{i}", type="hinge", axis="0 0 1")
    SubElement(foot, "inertial", pos="0 0 0", mass=xml(mass - here), diaginertia=turn)
    # contacts of a capsule, unlike those of a sphere, have friction along and across it
    lying = {"type": "capsule", "euler": "0 90 0", "contype": "0", "conaffinity": "0"}
    extent = xml(_THICK * size, _SHORT * size)
    SubElement(foot, "geom", name=f"foot_{i}", pos=f"0 0 {radius}", size=extent, **lying)
    SubElement(foot, "site", name=f"foot_{i}")
    return body


def _press(robot: Robot, i: int) -> float:
    return _PRESS * max(robot.grips[i])


# -- ground and actuators --------------------------------------------------------------------------


def _ground(robot: Robot, root: Element, soft: str) -> None:
    """Friction and drag on a line, of tendons as long as the position of a mass."""
    tendons = SubElement(root, "tendon")
    drag = np.broadcast_to(robot.drag, len(robot.mass))
    for i, (ahead, back, _) in enumerate(robot.grips):
        tendon = SubElement(tendons, "fixed", name=f"ground_{i}", damping=xml(drag[i]))
        if ahead + back:
            tendon.set("frictionloss", xml((ahead + back) / 2))
            tendon.set("solreffriction", soft)
            tendon.set("solimpfriction", _FIRM)
        SubElement(tendon, "joint", joint="x", coef="1")
        for j in range(i):
            SubElement(tendon, "joint", joint=f"link_{j}", coef="-1")


def _feet(robot: Robot, root: Element, soft: str) -> None:
    """Friction in the plane, and the headings of inner masses."""
    pairs, bonds = SubElement(root, "contact"), SubElement(root, "equality")
    for i, (ahead, back, aside) in enumerate(robot.grips):
        press = _press(robot, i)
        friction = xml((ahead + back) / 2 / press, aside / press, 0, 0, 0)
        at = {"name": f"ground_{i}", "geom1": "floor", "geom2": f"foot_{i}", "condim": "3"}
        SubElement(pairs, "pair", **at, friction=friction, solref=soft, solimp=_FIRM)
        if 0 < i < robot.links and robot.heading != "rear":
            share = "0.5" if robot.heading == "bisector" else "1"
            both = {"joint1": f"heading_{i}", "joint2": f"joint_{i - 1}"}
            by = f"0 {share} 0 0 0"
            SubElement(bonds, "joint", **both, polycoef=by, solref=soft, solimp=_FIRM)


def _drives(robot: Robot, actuators: Element, step: float) -> None:
    """Servos of positions and rates of the joints, or the springs of elastic links."""
    servos = [_rotor(robot, name) * (_SERVO / step) ** 2 for name in robot.joints]
    stiffness = servos if robot.elastic is None else robot.elastic[0]
    for name, firm in zip(robot.joints, stiffness, strict=True):
        SubElement(actuators, "position", name=name, joint=name, kp=xml(firm))
    for name in robot.joints if robot.elastic is None else ():
        damping = xml(2 * _rotor(robot, name) * _SERVO / step)
        SubElement(actuators, "velocity", name=f"{name}_rate", joint=name, kv=damping)


def _rotor(robot: Robot, joint: str) -> float:
    """Inertia of a joint's drive.

    It moves no mass on the ground if the joint follows its targets, and the heavier it is, the
    stiffer a servo may be.
    """
    force = sum(map(max, robot.grips)) + np.abs(robot.load).sum()
    inertia = _ROTOR * force * robot.cycle**2
    return float(inertia / robot.size if joint.startswith("link") else inertia * robot.size)


def _pushes(robot: Robot, actuators: Element) -> None:
    """Constant forces, which need no control: loads, and friction that differs ahead and back."""
    always = {"gainprm": "0", "biastype": "affine"}
    load = np.broadcast_to(robot.load, len(robot.mass))
    for i, (ahead, back, _) in enumerate(robot.grips):
        force = (back - ahead) / 2 - load[i]
        if force:
            at = {"tendon": f"ground_{i}"}
            if robot.planar:
                at = {"site": f"foot_{i}", "gear": "1 0 0 0 0 0"}
            SubElement(actuators, "general", name=f"push_{i}", **at, **always, biasprm=xml(force))
    if any(robot.trailed):
        ahead, left, moment = robot.trailed
        at = {"site": "foot_0", "gear": xml(ahead, left, 0, 0, 0, moment)}
        SubElement(actuators, "general", name="load", **at, **always, biasprm="1")


# -- keyframes -------------------------------------------------------------------------------------


def _keys(robot: Robot, root: Element, controls: int, steps: int) -> None:
    """A keyframe for each step; the first one is the start.

    Targets of positions are those of the step's begin and those of rates of its end, because
    MuJoCo takes springs at the begin and damping at the end.
    """
    times, value, rate = robot.table(steps)
    rows = value[:-1] if robot.elastic is not None else np.hstack([value[:-1], rate[1:]])
    rows = np.hstack([rows, np.zeros((steps, controls - rows.shape[1]))])
    keys = SubElement(root, "keyframe")
    for t, row in zip(times, rows, strict=False):
        SubElement(keys, "key", time=xml(t), ctrl=xml(*row))
    begin = robot.begin if robot.begin is not None else np.array([value[0], rate[0]])
    for word, root_row, row in zip(("qpos", "qvel"), robot.root, begin, strict=True):
        keys[0].set(word, xml(*_whole(robot, root_row, row)))


def _whole(robot: Robot, root: np.ndarray, row: np.ndarray) -> list[float]:
    """Values of all joints in the order of the bodies, from those of the root and of targets."""
    if not robot.planar:
        return [root[0], *row]
    share = {"rear": 0.0, "bisector": 0.5, "front": 1.0}[robot.heading]
    by_name = dict(zip(robot.joints, row, strict=True))
    found = [*root, 0.0]  # the foot of the head last
    for i in range(1, robot.links + 1):
        found += [by_name[name] for name in (f"link_{i - 1}", f"joint_{i - 1}") if name in by_name]
        found.append(0.0)
        if i < robot.links and share:
            found.append(share * by_name[f"joint_{i - 1}"])
    return found
