"""docs/equations.md, worms in the plane: our Models of chains, driven bodies and ground."""

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp

from tests.oracles.by_symbols import Symbols, zero
from wormopt.model.friction import Viscous
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic
from wormopt.systems.planar.dynamics.chain import Axes, RodMasses, planar_chain
from wormopt.systems.planar.dynamics.driven import driven_shape
from wormopt.systems.planar.shape import Shape, chain_shape, rigid_shape
from wormopt.systems.planar.swimming.swimmer import Swimmer

POSITIVE = ("mass", "rod_mass", "stiffness", "bending_stiffness")
DRAG = Axes(Viscous(1.0), Viscous(2.0))

# -- chain ----------------------------------------------------------------------------------------


@cache
def chain_of(links: int, *, rods: bool = False) -> tuple[Model, Symbols]:
    model = planar_chain(links, mass=1.0, stiffness=1.0, damping=1.0, rest_length=1.0,
                         bending_stiffness=1.0, bending_damping=1.0, rod_mass=1.0 if rods else None,
                         law=DRAG)  # fmt: skip
    return model, Symbols.of(model, positive=POSITIVE)


def vectors(column: Any) -> list[Any]:
    """Columns of 2, mass by mass."""
    return [column[2 * i : 2 * i + 2, :] for i in range(len(column) // 2)]


def cross(one: Any, two: Any) -> Any:
    return one[0] * two[1] - one[1] * two[0]


def energy_and_power(links: int, s: Symbols) -> tuple[Any, Any, Any]:
    """Elastic energy, Rayleigh's function and power of inputs, from lengths and angles."""
    r, v = vectors(s["position"]), s["velocity"]
    link = [r[j] - r[j + 1] for j in range(links)]
    size = [sp.sqrt(one.dot(one)) for one in link]
    angle = [sp.atan2(cross(link[j + 1], link[j]), link[j].dot(link[j + 1]))
             for j in range(links - 1)]  # fmt: skip
    shape = [*size, *angle]
    rates = [(sp.Matrix([one]).jacobian(s["position"]) * v)[0] for one in shape]
    names = [("stiffness", "damping", "rest_length")] * links
    names += [("bending_stiffness", "bending_damping", "rest_angle")] * (links - 1)
    V = R = power = sp.Integer(0)
    driven = [*s.column("input"), *(s.column("torque") if links > 1 else [])]
    for k, (c, damped, rest) in enumerate(names):
        j = k if k < links else k - links
        V += s.column(c)[j] * (shape[k] - s.column(rest)[j]) ** 2 / 2
        R += s.column(damped)[j] * rates[k] ** 2 / 2
        power += driven[k] * rates[k]
    return V, R, power


@pytest.mark.parametrize("links", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_chain_follows_from_lagrange(links: int):
    """Springs of links and joints, Rayleigh's dashpots, inputs and torques, ground and pull.

    Two links have all there is: a joint, an inner mass and ends. A joint knows its two links only.
    """
    model, s = chain_of(links)
    V, R, power = energy_and_power(links, s)
    v, ode = s["velocity"], s(model.ode)
    outer = s(model["ground_force"]) + s["pull"]
    assert zero(ode[: len(v), :] - v)
    change, rates = along_links(links, s)
    numbers = s.column(*(name for name in LINEAR if links > 1 or name not in OF_JOINTS))
    for i in range(len(v)):
        law = s["mass"][i // 2] * ode[len(v) + i] - outer[i]
        law += sp.diff(V, s["position"][i]) + sp.diff(R, v[i]) - sp.diff(power, v[i])
        for part in parts(law.subs(change, simultaneous=True), numbers):
            assert all(zero(piece) for piece in parts(part, rates))


LINEAR = ("stiffness", "damping", "input", "contact", "pull",
          "bending_stiffness", "bending_damping", "torque")  # fmt: skip
OF_JOINTS = ("bending_stiffness", "bending_damping", "torque")


def parts(expression: Any, symbols: Any) -> list[Any]:
    """What must vanish for an expression to vanish: its derivatives, and what is left at 0.

    Where all derivatives by some symbols are zero everywhere, these symbols change nothing.
    """
    slopes = [sp.diff(expression, symbol) for symbol in symbols]
    return [*slopes, expression.subs(dict.fromkeys(symbols, 0))]


def along_links(links: int, s: Symbols) -> tuple[dict[Any, Any], list[Any]]:
    """Places and velocities by those of the tail and along the links; the new velocities."""
    change, rates = {}, []
    for name in ("position", "velocity"):
        place = vectors(s[name])[links]
        for j in reversed(range(links)):
            link: Any = sp.Matrix(sp.symbols(f"{name}_of_link{j}_:2", real=True))
            place = place + link
            change |= dict(zip(vectors(s[name])[j], place, strict=True))
            rates += list(link) if name == "velocity" else []
    return change, [*rates, *vectors(s["velocity"])[links]]


@pytest.mark.parametrize("links", [1, 2])
def test_ground_acts_along_headings_and_takes_the_power_of_its_contacts(links: int):
    """Forces in the plane do the work of the contacts' own forces along their own velocities."""
    model, s = chain_of(links)
    power = sum(f * s.one(c.velocity) for f, c in zip(s["contact"], model.contacts, strict=True))
    assert zero(s(model["ground_force"]).dot(s["velocity"]) - power)


def test_heading_of_a_bisector_is_half_way():
    """psi_2 + phi / 2: the sum of both unit vectors, by the frame of the shape, for all phi."""
    phi = sp.Symbol("phi", real=True)
    shape = chain_shape(2)
    s = Symbols({"s": shape.s})
    looks = s(shape.headings)[1].subs(s["s"][2], phi)
    front, behind = (sp.Matrix([sp.cos(at), sp.sin(at)]) for at in (0, -phi))
    ahead = sp.Matrix([sp.cos(looks), sp.sin(looks)])
    gap = (front + behind - 2 * sp.cos(phi / 2) * ahead).applyfunc(sp.simplify)
    assert gap == sp.zeros(2, 1)


@pytest.mark.parametrize("links", [1, 2, pytest.param(3, marks=pytest.mark.slow)])
def test_masses_with_rods_from_their_kinetic_energy(links: int):
    """Energy of a rod whose ends move: integral along it; its matrix times our accelerations."""
    masses, rods = ca.SX.sym("m", links + 1), ca.SX.sym("M", links)
    v, F = ca.SX.sym("v", 2 * links + 2), ca.SX.sym("F", 2 * links + 2)
    s = Symbols({"m": masses, "M": rods, "v": v, "F": F}, positive=("m", "M"))
    inertia, share = RodMasses(masses, rods), sp.Symbol("share")
    ends = vectors(s["v"])
    T = sum(m * one.dot(one) for m, one in zip(s.column("m"), ends, strict=True)) / 2
    for j, rod in enumerate(s.column("M")):
        between = (1 - share) * ends[j] + share * ends[j + 1]
        T += rod * sp.integrate(sp.expand(between.dot(between)), (share, 0, 1)) / 2
    assert zero(s.one(inertia.kinetic(v)) - T)
    matrix = sp.hessian(T, list(s["v"]))
    assert zero(matrix * s(inertia.solve(F)) - s["F"])


# -- driven ---------------------------------------------------------------------------------------


def driven(shape: Shape) -> tuple[Model, Symbols]:
    """A body of which the shape variables are any quadratics of time, as on a piece of a gait."""
    size = shape.s.numel()
    course = Gait(np.array([0.0, 1.0]), np.ones((1, size, 1)) * [1.0, 1.0, -1.0]) if size else None
    model = driven_shape(shape, course, mass=1.0, inertia=0.5, law=DRAG)
    return model, Symbols.of(model, ("mass", "inertia"))


BODIES = {"two masses": lambda: chain_shape(1), "three": lambda: chain_shape(2, lengths=(1, 2)),
          "rod": lambda: rigid_shape([(1.0, 0.0), (-1.0, 0.0)])}  # fmt: skip


def moved(model: Model, s: Symbols, expression: Any) -> Any:
    """Time derivative along the Model's own ode."""
    states = s.column(*(signal.name for signal in model.x))
    change = sp.Matrix(expression).jacobian(states) * s(model.ode)
    return change + sp.Matrix(expression).diff(s["t"])


@pytest.mark.parametrize(
    "body", [pytest.param(name, marks=[pytest.mark.slow] * (name != "rod")) for name in BODIES]
)
def test_driven_bodies_obey_newton_and_euler(body: str):
    """Places differentiated twice: momentum and spin of all masses change by all outer forces."""
    model, s = driven(BODIES[body]())
    places, speeds = s(model["position"]), s(model["velocity"])
    assert zero(moved(model, s, places) - speeds)
    accelerations = vectors(moved(model, s, speeds))
    outer = vectors(s(model["ground_force"]) + s["pull"])
    m, r = s["mass"], vectors(places)
    masses, forces = range(len(r)), s.column("contact", "pull")
    momentum: Any = sum((m[i] * accelerations[i] - outer[i] for i in masses), sp.zeros(2, 1))
    assert all(zero(part) for entry in momentum for part in parts(entry, forces))
    turned = s["inertia"] * s(model.ode)[5]
    spin = sum(cross(r[i], m[i] * accelerations[i] - outer[i]) for i in masses)
    assert all(zero(part) for part in parts(spin + turned, forces))
    if body != "rod":  # behind the tail no load is left over
        left = s(model["left_over"])
        assert all(zero(part) for entry in left for part in parts(entry, forces))


# -- ground ---------------------------------------------------------------------------------------

LAW = {name: ca.SX.sym(name) for name in ("F", "B", "N", "ahead", "aside", "width")}
G = Symbols(LAW, positive=("F", "B", "N", "width"))
VELOCITY = ca.vertcat(LAW["ahead"], LAW["aside"])
V: Any = sp.Matrix([G["ahead"], G["aside"]])
SIDES = [1, -1]


@pytest.mark.parametrize("way", SIDES)
def test_elliptic_ground_is_minus_the_gradient_of_its_power(way: int):
    """Ahead and back: F = -grad psi, on the edge of the ellipse; it slides against the normal."""
    law, signs = Elliptic(LAW["F"], LAW["B"], LAW["N"]), {G["ahead"]: way}
    along = G["F"] if way > 0 else G["B"]
    psi = G.one(law.power(VELOCITY), signs)
    assert zero(psi**2 - (along * V[0]) ** 2 - (G["N"] * V[1]) ** 2)
    force: Any = G(law.slip_force(VELOCITY), signs)
    assert zero(force + sp.Matrix([psi]).jacobian(V).T)
    assert zero(force.dot(V) + psi)
    held = sp.Matrix([force[0] / along, force[1] / G["N"]])
    gauge = G.one(law.gauge(VELOCITY), {G["ahead"]: -way})  # a force back, as it slides ahead
    assert zero((gauge**2).subs(dict(zip(V, force, strict=True)), simultaneous=True) - 1)
    assert zero(held.dot(held) - 1)
    normal = G(law.slip_direction(VELOCITY), {G["ahead"]: -way})
    there = normal.subs(dict(zip(V, force, strict=True)), simultaneous=True)
    assert zero(there * psi - V)
    smooth = G(law.smooth(VELOCITY, LAW["width"]), {**signs, **largest_first()})
    rounded = sp.sqrt(psi**2 + (G["width"] * G["F"]) ** 2)
    assert zero(smooth + sp.Matrix([rounded]).jacobian(V).T)


def largest_first() -> dict[Any, int]:
    """One case of three: F+ is the largest resistance, which is but the name of a width."""
    return {G["F"] - G["B"]: 1, G["F"] - G["N"]: 1}


@pytest.mark.parametrize("way", SIDES)
def test_unit_ground_has_the_same_ellipse(way: int):
    law, signs = AnisotropicCoulomb(LAW["F"], LAW["B"], LAW["N"]), {G["ahead"]: way}
    along = G["F"] if way > 0 else G["B"]
    size = sp.sqrt(V.dot(V))
    force: Any = G(law.slip_force(VELOCITY), signs)
    assert zero(force + sp.Matrix([along * V[0], G["N"] * V[1]]) / size)
    assert zero((force[0] / along) ** 2 + (force[1] / G["N"]) ** 2 - 1)
    normal = G(law.slip_direction(VELOCITY), {G["ahead"]: -way})
    there = normal.subs(dict(zip(V, force, strict=True)), simultaneous=True)
    assert zero(there * size - V)
    # associated only if isotropic: curl of the force in the plane of velocities
    curl = sp.diff(force[1], V[0]) - sp.diff(force[0], V[1])
    assert zero(curl * size**3 - (G["N"] - along) * V[0] * V[1])


def test_ground_along_the_line_is_that_of_one_dimension():
    """No sideways velocity: Elliptic and AnisotropicCoulomb are Coulomb's -F+ and +F-."""
    for law in (
        Elliptic(LAW["F"], LAW["B"], LAW["N"]),
        AnisotropicCoulomb(LAW["F"], LAW["B"], LAW["N"]),
    ):
        for way, known in ((1, -G["F"]), (-1, G["B"])):
            force = G(law.slip_force(VELOCITY), {G["ahead"]: way}).subs(G["aside"], 0)
            speed = sp.Symbol("speed", positive=True)
            assert zero(force.subs(G["ahead"], way * speed) - sp.Matrix([known, 0]))


# -- swimming -------------------------------------------------------------------------------------


def swimmer_of(links: int) -> tuple[Swimmer, Symbols]:
    swimmer = Swimmer(chain_shape(links), rods=(2.0, 3.0), masses=(5.0, 7.0))
    shape = swimmer.shape
    columns = {"s": shape.s, "rates": shape.rates, "twist": shape.twist}
    return swimmer, Symbols(columns, positive=["s"])


def test_power_of_a_rod_is_the_integral_along_it():
    """c_t v_t² + c_n v_n² with a velocity linear along the rod, and points at both ends.

    Linear in the four drags; they are primes, and so no two of their terms are alike.
    """
    swimmer, s = swimmer_of(1)
    length, rate = s["s"], s["rates"]
    X, Y, turn = s["twist"]
    # the rod lies from its head at 0 back to -length along x
    at = sp.Symbol("at")
    v: Any = sp.Matrix([X - rate * at / length, Y - turn * at])
    rod = sp.integrate(sp.expand(2 * v[0] ** 2 + 3 * v[1] ** 2), (at, 0, length))
    ends: list[Any] = [v.subs(at, 0), v.subs(at, length)]
    points = sum(5 * e[0] ** 2 + 7 * e[1] ** 2 for e in ends)
    assert zero(s.one(swimmer.power) - rod - points)


@pytest.mark.slow
def test_connection_balances_all_drags():
    """The twist A s' makes the power stationary: no force and no moment is left."""
    shape = chain_shape(2, lengths=(1.0, 1.0))
    swimmer = Swimmer(shape, rods=(2.0, 3.0))
    s = Symbols({"s": shape.s, "rates": shape.rates, "twist": shape.twist})
    twist = s(swimmer.connection) * s.column("rates")
    gradient = sp.Matrix([s.one(swimmer.power)]).jacobian(s["twist"])
    assert zero(gradient.subs(dict(zip(s["twist"], twist, strict=True)), simultaneous=True))
    power = s.one(swimmer.power).subs(dict(zip(s["twist"], twist, strict=True)), simultaneous=True)
    assert zero(power - s.one(swimmer.metric) * s["rates"] ** 2)
