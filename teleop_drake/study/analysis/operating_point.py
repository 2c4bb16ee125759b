"""Operating points on the tool's path."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import System

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.surface import (
    CONTACT,
    EMPTY,
    FindSurface,
    LastPassed,
    ShownNormal,
    Surface,
    SurfacesOf,
)
from teleop_drake.loops.framework.validation import Refuse, ScenarioError
from teleop_drake.loops.numerics.bisection import halve
from teleop_drake.model.blocks.environments.base import ForceAt, StiffnessAndDamping
from teleop_drake.model.blocks.robots import FactsOfConfig
from teleop_drake.model.scenario import AsTeleoperation, Scenario, ScenarioLike

POSITION = "position"
"""The key of charts for the tool's position on its path; see OperatingPointAt."""

# The range in m in which the depth of an impact is searched.
_SHORTEST_IMPACT = 1e-9
_DEEPEST_IMPACT = 10.0

# A position closer than the first distance in m to a surface counts as on it. The
# operating point is then the second distance behind the surface.
_ON_SURFACE = 1e-7
_BEHIND = 1e-6

# The number of Newton's steps to the point at which a tool rests, and the largest share
# of the force that may remain unbalanced there.
_REST_STEPS = 12
_AT_REST = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingPoint:
    """A point at which the diagram is linearised.

    Attributes:
        name: The point's name. The functions below use the name of the material at the
            point; the name of the surface before the point if there is no material; or
            EMPTY.
        position: p_WT in m (n).
        velocity: v_WT in m/s (n).
        estimates: State of an adaptive law, [F_c, W1, Psi, W3] as in
            AdaptiveBackstepping; None for the initial state.
        holds_force: Whether the operator has perceived contact and holds a force;
            otherwise it commands a velocity.
    """

    name: str
    position: Array
    velocity: Array
    estimates: Array | None = None
    holds_force: bool = False


def OperatingPoints(
    scenario: ScenarioLike, *, environment: System | None = None
) -> list[OperatingPoint]:
    """Returns an operating point in each layer of the tool's path.

    The path is the straight line from the tool's start with the commanded velocity. It
    ends with the duration of the scenario, at the robot's limit of reach or at the
    contact surface. In each layer the point is in the middle of the path. If the path
    reaches the contact surface, another point is at the greatest depth of the first
    impact: at rest, where the spring has absorbed the kinetic energy of the tool's
    inertia and velocity along the normal.

    Args:
        scenario: A valid scenario, or its name or file.
        environment: The block of the environment, which may be your own. By default it
            is made from the scenario.

    Raises:
        ScenarioError: If the environment does not declare its surfaces.
    """
    scenario = AsTeleoperation(scenario)
    start = np.asarray(scenario.robot.start, dtype=float)
    velocity = np.asarray(scenario.surgeon.velocity, dtype=float)
    block = environment or scenario.environment.MakeEnvironment(start)
    surfaces = SurfacesOf(block)
    if surfaces is None:
        allowed = (
            "one that reports its Surfaces(), between which operating points lie; for "
            "any other, pass an OperatingPoint to AnalyzeStability()"
        )
        Refuse("environment", type(block).__name__, allowed)
    # The end of the path, and the times at which the tool crosses surfaces before it.
    contact = FindSurface(surfaces, CONTACT)
    arrival = math.inf
    if contact is not None and contact.Along(velocity) > 0:
        arrival = _CrossingTime(contact, start, velocity)
    end_time = min(scenario.duration, arrival)
    end_time = _ReachableTime(scenario, start, velocity, end_time)
    crossings = {_CrossingTime(surface, start, velocity) for surface in surfaces}
    times = sorted([0.0, end_time, *(t for t in crossings if 0 < t < end_time)])
    points = [
        _MakePoint(surfaces, start + velocity * (begin + end) / 2, velocity)
        for begin, end in pairwise(times)
    ]
    # The point on the contact surface. The mobility along the normal is the inverse of
    # the effective mass.
    if contact is not None and end_time == arrival:
        position = start + velocity * end_time
        inertia = FactsOfConfig(replace(scenario.robot, start=position)).inertia
        if inertia is None:
            Refuse("robot", scenario.robot.kind, "a robot that reports its inertia")
        normal = contact.normal_W
        mobility = normal @ np.linalg.inv(inertia) @ normal
        energy = contact.Along(velocity) ** 2 / mobility / 2
        position += _DepthOfImpact(block, contact, position, energy) * normal
        points.append(_MakePoint(surfaces, position, 0 * velocity))
    return points


def _CrossingTime(surface: Surface, start: Array, velocity: Array) -> float:
    """Returns the time in s at which the path's line crosses a surface.

    It is infinite if the line is parallel to the surface, and negative if the surface
    is behind the start.
    """
    speed = surface.Along(velocity)
    return float(-surface.Depth(start) / speed) if speed else math.inf


def _DepthOfImpact(
    environment: System, surface: Surface, position: Array, energy: float
) -> float:
    """Returns the greatest depth in m of an impact with a kinetic energy in J.

    For a material with the stiffness k it is sqrt(2 energy/k). Otherwise it is the
    depth at which the static force of the environment has done this work.
    """
    material = surface.material
    if material is not None and material.stiffness > 0:
        return math.sqrt(2 * energy / material.stiffness)
    # The work is integrated by Gauss's rule, and the depth found by doubling and
    # bisection.
    nodes, weights = np.polynomial.legendre.leggauss(16)
    normal = surface.normal_W
    at_rest = np.zeros_like(position)

    def Work(depth: float) -> float:
        ways = (nodes + 1) / 2 * depth
        forces = [
            surface.Along(ForceAt(environment, position + way * normal, at_rest))
            for way in ways
        ]
        return float(weights @ forces) * depth / 2

    low = 0.0
    high = _SHORTEST_IMPACT
    while Work(high) < energy:
        if high > _DEEPEST_IMPACT:
            raise ScenarioError(
                f"environment.{surface.name} = a surface into which a tool of "
                f"{energy:g} J comes deeper than {_DEEPEST_IMPACT:g} m: must be one "
                "that stops it"
            )
        low = high
        high = 2 * high
    return halve(lambda depth: Work(depth) < energy, low, high)[1]


def IsBehindContact(surfaces: Sequence[Surface], position: Array) -> bool:
    """Returns whether a position in m is behind a contact surface."""
    contact = FindSurface(surfaces, CONTACT)
    return contact is not None and bool(contact.Depth(position) > 0)


def PointOfRest(
    point: OperatingPoint, environment: System, force: ArrayLike
) -> OperatingPoint | None:
    """Returns the point at which a tool rests on the contact surface under a force.

    There the environment's force equals the operator's. In directions in which the
    environment has no stiffness, the tool stays at the given point.

    Args:
        point: The point at which Newton's method starts.
        environment: The block of the environment.
        force: The force that the operator holds, in N (n).

    Returns:
        The point; None if there is no contact surface, or if the tool does not rest
        behind it under the force, because it leaves the surface or slides along it.
    """
    held = np.asarray(force, dtype=float)
    at_rest = np.zeros_like(point.velocity)
    position = point.position
    for _ in range(_REST_STEPS):
        stiffness, _ = StiffnessAndDamping(environment, position)
        excess = held - ForceAt(environment, position, at_rest)
        position = position + np.linalg.lstsq(stiffness, excess, rcond=1e-9)[0]
    excess = held - ForceAt(environment, position, at_rest)
    surfaces = SurfacesOf(environment) or ()
    if (
        not IsBehindContact(surfaces, position)
        or np.abs(excess).max() > _AT_REST * np.abs(held).max()
    ):
        return None
    return replace(point, position=position, velocity=at_rest, holds_force=True)


def OperatingPointAt(scenario: Scenario, position: float) -> OperatingPoint:
    """Returns the operating point at a position along the tool's path.

    The tool has the commanded velocity, or is at rest behind the contact surface. For a
    position on a surface, where there is no linear model, the point is just behind the
    surface.

    Args:
        scenario: A teleoperation.
        position: The component of p_WT in m along the normal of the contact surface.
            Without a contact surface, it is along the normal of the puncture surface,
            and without both along x.

    Raises:
        ScenarioError: If the position is not on the path or the robot cannot reach it.
    """
    start = np.asarray(scenario.robot.start, dtype=float)
    velocity = np.asarray(scenario.surgeon.velocity, dtype=float)
    surfaces = scenario.Surfaces()
    normal = ShownNormal(surfaces, len(start))
    begin = float(normal @ start)
    speed = float(normal @ velocity)
    way = position - begin
    if not math.isfinite(position) or (way != 0 and not way * speed > 0):
        allowed = f"on the tool's path, from {begin:g} m on with {speed:g} m/s"
        Refuse(POSITION, position, allowed)
    time = way / speed if way else 0.0
    for surface in surfaces:
        crossing = _CrossingTime(surface, start, velocity)
        if speed and abs(crossing - time) * abs(speed) < _ON_SURFACE:
            time = crossing + _BEHIND / abs(speed)
    p_WT = start + velocity * time
    try:
        scenario.robot.JointPositions(p_WT)
    except ScenarioError as e:
        # The robot's message begins with the name of its field for the position.
        reason = str(e).removeprefix("start = ")
        raise ScenarioError(f"{POSITION} = {position:g}: {reason}") from e
    if IsBehindContact(surfaces, p_WT):
        velocity = 0 * velocity
    return _MakePoint(surfaces, p_WT, velocity)


def _MakePoint(
    surfaces: tuple[Surface, ...], position: Array, velocity: Array
) -> OperatingPoint:
    """Returns an operating point, named after the material or surface passed last."""
    surface = LastPassed(surfaces, position)
    name = EMPTY
    if surface is not None:
        material = surface.material
        name = surface.name if material is None else material.name
    return OperatingPoint(name=name, position=position, velocity=velocity)


def _ReachableTime(
    scenario: Scenario, start: Array, velocity: Array, end_time: float
) -> float:
    """Returns the time in s up to which the robot can follow the path."""

    def IsReachable(time: float) -> bool:
        try:
            scenario.robot.JointPositions(start + velocity * time)
        except ScenarioError:
            return False
        return True

    if IsReachable(end_time):
        return end_time
    return halve(IsReachable, 0.0, end_time)[0]
