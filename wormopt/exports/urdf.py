"""URDF: a worm for ROS, Gazebo and other engines, and a table of its joints.

It is a free robot on the ground: URDF has neither friction of the ground nor drag, loads, springs
or start, but Gazebo reads friction along and across a link from elements of its own.
"""

from __future__ import annotations

import csv
import io
from xml.etree.ElementTree import Element

import numpy as np

from wormopt.exports.mjcf import add, steps_of, written
from wormopt.exports.robot import Robot
from wormopt.model.gait_table import remark_of_gait
from wormopt.quantities import GRAVITY

_THICK = 0.05  # radius of a mass over the length of a link
_SLIPPERY = 0.5  # largest friction over weight of a body without masses in its scene
_LEAST = 1e-6  # mass of a body between two joints over that behind it
_FREE = 0.05  # of the range of a joint, kept beyond its targets


def make(robot: Robot, stem: str, step: float = 0.01) -> dict[str, bytes]:
    """``STEM.urdf``, and ``STEM_joints.csv``: a closed cycle in equal steps of at most `step`."""
    root = Element("robot", name=stem)
    for i in range(len(robot.mass)):
        _body(robot, root, i)
    control = add(root, "ros2_control", name=stem, type="system")
    add(add(control, "hardware"), "plugin", "mock_components/GenericSystem")
    for name in robot.joints:
        joint = add(control, "joint", name=name)
        add(joint, "command_interface", name="position")
        for state in ("position", "velocity"):
            add(joint, "state_interface", name=state)
    return {
        f"{stem}.urdf": written(root, robot, _notes(robot)),
        f"{stem}_joints.csv": _table(robot, step),
    }


def _notes(robot: Robot) -> tuple[str, ...]:
    """Remarks on what URDF lacks."""
    found = ["friction of the ground is a coefficient along and across each mass, for Gazebo only"]
    if any(ahead != back for ahead, back, _ in robot.grips):
        found.append(
            "friction ahead and back is replaced by its mean: a worm that needs the difference "
            "stays in place; add a plugin that pushes its masses, or use MJCF"
        )
    if np.any(robot.drag) or np.any(robot.load) or any(robot.trailed) or robot.fall:
        found.append("drag and loads are missing")
    if robot.elastic is not None:
        found.append("links have dashpots, but no springs: their servos are those of the simulator")
    if robot.massless:
        found.append(
            f"friction is {_SLIPPERY:g} of the weight of each mass, but 0 in the scene: run the "
            "gait slowly"
        )
    return tuple(found)


def _body(robot: Robot, root: Element, i: int) -> None:
    """Mass i and the joints to it; a link and an angle need a body between them."""
    body = add(root, "link", name=f"mass_{i}")
    ahead, back, aside = robot.grips[i]
    radius, mass = _THICK * robot.size, robot.mass[i]
    if robot.massless:
        mass = max(ahead, back, aside) / (_SLIPPERY * GRAVITY)
    _inertia(body, mass, radius)
    for part in ("visual", "collision"):
        add(add(add(body, part), "geometry"), "sphere", radius=radius)
    gazebo, along = add(root, "gazebo", reference=f"mass_{i}"), (ahead + back) / 2
    for tag, force in (("mu1", along), ("mu2", aside if robot.planar else along)):
        add(gazebo, tag, repr(float(force / (mass * GRAVITY))))
    add(gazebo, "fdir1", "1 0 0")
    if i == 0:
        return
    link, bend, before = f"link_{i - 1}", f"joint_{i - 1}", f"mass_{i - 1}"
    away = robot.lengths[i - 1] if robot.lengths else 0.0
    if bend not in robot.joints:
        _joint(robot, root, link, (before, f"mass_{i}"), away)
        return
    if link in robot.joints:
        _inertia(add(root, "link", name=f"end_{i}"), mass * _LEAST, radius)
        _joint(robot, root, link, (before, f"end_{i}"), 0.0)
        before = f"end_{i}"
    _joint(robot, root, bend, (before, f"mass_{i}"), away)


def _inertia(body: Element, mass: float, radius: float) -> None:
    inertial, ball = add(body, "inertial"), 0.4 * mass * radius**2
    add(inertial, "mass", value=mass)
    add(inertial, "inertia", ixx=ball, iyy=ball, izz=ball, ixy="0", ixz="0", iyz="0")


def _joint(robot: Robot, root: Element, name: str, ends: tuple[str, str], away: float) -> None:
    """Joint between two bodies, the second one `away` behind; fixed if it has no target."""
    moves, slides = name in robot.joints, name.startswith("link")
    kind = ("prismatic" if slides else "revolute") if moves else "fixed"
    joint = add(root, "joint", name=name, type=kind)
    add(joint, "origin", xyz=(0.0 - away, 0, 0))
    for word, body in zip(("parent", "child"), ends, strict=True):
        add(joint, word, link=body)
    if not moves:
        return
    j = robot.joints.index(name)
    low, high, rate = robot.reach[j].tolist()
    free = (high - low) * (_FREE if robot.elastic is None else 1.0)  # springs give way
    add(joint, "axis", xyz="-1 0 0" if slides else "0 0 -1")
    # URDF demands an effort, and scenes have none
    add(joint, "limit", lower=low - free, upper=high + free, velocity=2 * rate, effort="1e6")
    if robot.elastic is not None:
        add(joint, "dynamics", damping=robot.elastic[1, j])


def _table(robot: Robot, step: float) -> bytes:
    times, value, rate = robot.table(steps_of(robot, step))
    text = io.StringIO()
    text.write("".join(f"# {line}\n" for line in robot.remarks))
    text.write(f"# {remark_of_gait('link', robot.cycle, 's')}\n" if not robot.planar else "")
    writer = csv.writer(text, lineterminator="\n")
    units = ["m" if name.startswith("link") else "rad" for name in robot.joints]
    heads = [f"{name} [{unit}]" for name, unit in zip(robot.joints, units, strict=True)]
    heads += [f"{name}_rate [{unit} s-1]" for name, unit in zip(robot.joints, units, strict=True)]
    writer.writerow(["time [s]", *heads])
    writer.writerows(np.column_stack([times, value, rate]).tolist())
    return text.getvalue().encode()
