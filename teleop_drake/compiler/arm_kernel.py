"""The kernels of what drives an arm beside its task."""

import numpy as np
from numpy.typing import NDArray

from teleop_drake.compiler.plant_tree import ReadPlantTree
from teleop_drake.kernel import Kernel, Term
from teleop_drake.laws.posture import (
    PostureGains,
    orientation_torque,
    posture_torque,
)
from teleop_drake.numerics.rigid_body import (
    RigidBodyTree,
    calc_link_turn,
    calc_mass_matrix,
    calc_point_motion,
    make_work,
    mass_matrix,
)
from teleop_drake.systems.gravity_compensation import GravityCompensation
from teleop_drake.systems.posture_hold import PostureHold

Array = NDArray[np.float64]


def gravity_torque(
    tree: RigidBodyTree, state: Array, work: Array, torque: Array
) -> Array:
    """Returns what carries the weight of a plant at rest, N m or N (n).

    Args:
        tree: Its links.
        state: [q; v].
        work: As make_work() returns it.
        torque: To work in (n).
    """
    n = len(torque)
    calc_mass_matrix(tree, state[:n], np.zeros(n), work, torque)
    return torque


def hold_posture(
    gains: PostureGains,
    q_0: Array,
    tree: RigidBodyTree,
    link: int,
    point: Array,
    num_axes: int,
    state: Array,
    work: Array,
    motion: Array,
) -> Array:
    """Returns posture_torque() of a plant.

    Args:
        gains: How.
        q_0: The posture (n).
        tree: The links of the plant.
        link: Index of the link with the tool.
        point: Where the tool is in the link's frame, m (3).
        num_axes: Number of task axes.
        state: [q; v].
        work: As make_work() returns it.
        motion: To work in (6 + 3 n).
    """
    n = len(q_0)
    q, v, bias = state[:n], state[n:], np.empty(n)
    calc_mass_matrix(tree, q, v, work, bias)
    calc_point_motion(tree, link, point, work, motion)
    J_v = motion[6:].reshape(3, n)[:num_axes]
    return posture_torque(gains, mass_matrix(work), J_v, q_0, q, v)


def hold_orientation(
    gains: PostureGains,
    q_0: Array,
    R_0: Array,
    R_LB: Array,
    tree: RigidBodyTree,
    link: int,
    point: Array,
    num_axes: int,
    state: Array,
    work: Array,
    motion: Array,
    turn: Array,
) -> Array:
    """Returns orientation_torque() of a plant.

    Args:
        gains: How.
        q_0: The posture (n).
        R_0: The rotation of the tool that is held (3, 3).
        R_LB: Rotation of the tool in the link's frame (3, 3).
        tree: The links of the plant.
        link: Index of the link with the tool.
        point: Where the tool is in the link's frame, m (3).
        num_axes: Number of task axes.
        state: [q; v].
        work: As make_work() returns it.
        motion: To work in (6 + 3 n).
        turn: To work in (9 + 3 n).
    """
    n = len(q_0)
    q, v, bias = state[:n], state[n:], np.empty(n)
    calc_mass_matrix(tree, q, v, work, bias)
    calc_point_motion(tree, link, point, work, motion)
    calc_link_turn(tree, link, work, turn)
    J_v = motion[6:].reshape(3, n)[:num_axes]
    R = turn[:9].reshape(3, 3) @ R_LB
    J_w = turn[9:].reshape(3, n)
    return orientation_torque(gains, mass_matrix(work), J_v, J_w, R_0, R, q_0, q, v)


def GravityKernel(block: GravityCompensation) -> Kernel:
    """Returns the kernel of the block that carries an arm's weight.

    Args:
        block: The block.

    Raises:
        UnsupportedSystem: If ReadPlantTree() cannot read the model.
    """
    model = block.model
    read = ReadPlantTree(model, model.CreateDefaultContext())
    n = model.num_velocities()
    return Kernel(
        parameters={
            "tree": read.tree,
            "work": make_work(n),
            "torque": np.zeros(n),
        },
        outputs={
            "gravity_torque": (gravity_torque, "tree", "plant_state", "work", "torque")
        },
    )


def HoldKernel(block: PostureHold) -> Kernel:
    """Returns the kernel of the block that holds what the task leaves free.

    Args:
        block: The block.

    Raises:
        UnsupportedSystem: If ReadPlantTree() cannot read the plant.
    """
    plant, (q_0, R_0) = block.plant, block.held
    read = ReadPlantTree(plant, plant.CreateDefaultContext())
    link, X_LB = read.poses[block.tool_index]
    n = plant.num_velocities()
    parameters = {
        "gains": block.gains,
        "q_0": q_0,
        "tree": read.tree,
        "point": X_LB.translation(),
        "work": make_work(n),
        "motion": np.zeros(6 + 3 * n),
    }
    place = ("tree", link, "point", block.num_axes, "plant_state", "work", "motion")
    law: Term = (hold_posture, "gains", "q_0", *place)
    if R_0 is not None:
        parameters |= {
            "R_0": R_0,
            "R_LB": X_LB.rotation().matrix(),
            "turn": np.zeros(9 + 3 * n),
        }
        law = (hold_orientation, "gains", "q_0", "R_0", "R_LB", *place, "turn")
    return Kernel(parameters=parameters, outputs={"hold_torque": law})
