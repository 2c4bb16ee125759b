"""The springs and dampers of a MultibodyPlant, of those kinds that are linear."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from pydrake.multibody import tree as multibody
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from teleop_drake.loops.engine.plant_tree import PlantTree
from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.numerics.rigid_body import (
    RigidBodyTree,
    calc_jacobian,
    calc_motion,
)

_OF_JOINTS = (multibody.RevoluteSpring, multibody.PrismaticSpring)
_KNOWN = (*_OF_JOINTS, multibody.LinearSpringDamper)


class Springs(NamedTuple):
    """Springs of a plant: n joints, and s springs between two points of links.

    Attributes:
        stiffness: The stiffness of each joint, N m/rad or N/m (n).
        preload: Its force at q = 0, N m or N (n).
        links: The links of each spring's two points, -1 for the world (s, 2).
        points: The points in the links' frames, m (s, 2, 3).
        constants: The stiffness in N/m, the free length in m and the damping in N s/m
            of each spring between points (s, 3).
    """

    stiffness: Array
    preload: Array
    links: Indices
    points: Array
    constants: Array


def ForceElements(plant: MultibodyPlant) -> Iterator[Any]:
    """Yields the force elements of a plant besides gravity."""
    for i in range(plant.num_force_elements()):
        element = plant.get_force_element(multibody.ForceElementIndex(i))
        if not isinstance(element, multibody.UniformGravityFieldElement):
            yield element


def IsSpring(element: Any) -> bool:
    """Returns whether a force element is one that ReadSprings() reads."""
    return isinstance(element, _KNOWN)


def ReadSprings(plant: MultibodyPlant, context: Context, read: PlantTree) -> Springs:
    """Returns the springs of a plant, all of whose force elements are springs.

    Args:
        context: The plant's Context.
        read: The plant's tree.
    """
    n = plant.num_velocities()
    stiffness = np.zeros(n)
    preload = np.zeros(n)
    between = []
    for element in ForceElements(plant):
        if not isinstance(element, _OF_JOINTS):
            between.append(element)
            continue
        i = element.joint().velocity_start()
        k, rest = _OfJoint(element, context)
        stiffness[i] += k
        preload[i] += k * rest
    links = np.full((len(between), 2), -1)
    points = np.zeros((len(between), 2, 3))
    for i, spring in enumerate(between):
        ends = (spring.bodyA(), spring.p_AP()), (spring.bodyB(), spring.p_BQ())
        for j, (body, point) in enumerate(ends):
            link, X_LB = read.poses[int(body.index())]
            links[i, j] = link
            points[i, j] = X_LB @ np.asarray(point)
    constants = [(x.stiffness(), x.free_length(), x.damping()) for x in between]
    return Springs(
        stiffness, preload, links, points, np.array(constants).reshape(-1, 3)
    )


def _OfJoint(spring: Any, context: Context) -> tuple[float, float]:
    """Returns the stiffness of a joint's spring, and the joint's position at rest."""
    if isinstance(spring, multibody.RevoluteSpring):
        return spring.GetStiffness(context), spring.GetNominalAngle(context)
    return spring.stiffness(), spring.nominal_position()


def forces_with_springs(
    springs: Springs, tree: RigidBodyTree, state: Array, generalized_force: Array
) -> Array:
    """Returns generalized forces, to which those of springs are added, N m or N (n).

    Args:
        springs: The springs of the plant.
        tree: The plant's links and joints.
        state: The joint positions and velocities [q; v] (2 n).
        generalized_force: The other forces, N m or N (n).
    """
    q, v = np.split(state, 2)
    forces = generalized_force + springs.preload - springs.stiffness * q
    if len(springs.links) == 0:
        return forces
    motion = calc_motion(tree, q, v)
    for i in range(len(springs.links)):
        stiffness, free_length, damping = springs.constants[i]
        link_P, link_Q = springs.links[i]
        p_P, J_P = calc_jacobian(tree, motion, link_P, springs.points[i, 0])
        p_Q, J_Q = calc_jacobian(tree, motion, link_Q, springs.points[i, 1])
        length = np.sqrt(np.sum((p_Q - p_P) ** 2))
        direction = (p_Q - p_P) / length
        # The rate of the length is `towards @ v`.
        towards = direction @ (J_Q[3:] - J_P[3:])
        tension = stiffness * (length - free_length) + damping * (towards @ v)
        forces = forces - towards * tension
    return forces
