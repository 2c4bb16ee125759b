"""The kernels of a MultibodyPlant, and of what asks one."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from teleop_drake.compiler.plant_tree import ReadPlantTree
from teleop_drake.kernel import Kernel, Term
from teleop_drake.laws.gaussian_network import basis_functions
from teleop_drake.laws.task_space import joint_torques, tool_kinematics
from teleop_drake.laws.tracking import (
    disturbance_estimate,
    dynamics_vector,
    tracking_error,
    tracking_force_vector,
    weights_rate_vector,
)
from teleop_drake.numerics.rigid_body import (
    RigidBodyTree,
    calc_accelerations,
    calc_kinematics,
    calc_mass_matrix,
    calc_point_acceleration,
    calc_point_motion,
    make_work,
    mass_matrix,
)
from teleop_drake.systems.network_tracking_controller import NetworkTrackingController
from teleop_drake.systems.tool_interface import ToolInterface

Array = NDArray[np.float64]


def plant_rate(
    tree: RigidBodyTree,
    actuated: NDArray[np.int64],
    effort_limits: Array,
    state: Array,
    actuation: Array,
    generalized_force: Array,
    work: Array,
    forces: Array,
    result: Array,
) -> Array:
    """Returns [v; v_dot] of a plant.

    Args:
        tree: Its links.
        actuated: The velocity that each actuator acts on.
        effort_limits: What each actuator can do at most, N m or N.
        state: [q; v].
        actuation: What each actuator is to do, N m or N.
        generalized_force: What else acts on the joints, N m or N (n).
        work: As make_work() returns it.
        forces: To work in (n).
        result: To work in (2 n).
    """
    n = len(forces)
    for i in range(n):
        forces[i] = generalized_force[i]
        result[i] = state[n + i]
    for k in range(len(actuated)):
        effort = min(max(actuation[k], -effort_limits[k]), effort_limits[k])
        forces[actuated[k]] += effort
    calc_accelerations(tree, state[:n], state[n:], forces, work, result[n:])
    return result


def body_accelerations(
    tree: RigidBodyTree,
    links: NDArray[np.int64],
    points: Array,
    rate: Array,
    work: Array,
    result: Array,
) -> Array:
    """Returns the translational accelerations of points of links, one after another.

    Args:
        tree: The links.
        links: Index of the link that each point belongs to.
        points: The points in the links' frames, m (k, 3).
        rate: What plant_rate() has just returned.
        work: What it worked in.
        result: To work in (3 k).
    """
    v_dot = rate[len(rate) // 2 :]
    for i in range(len(links)):
        a = result[3 * i : 3 * i + 3]
        calc_point_acceleration(tree, links[i], points[i], v_dot, work, a)
    return result


def tool_motion(
    tree: RigidBodyTree,
    link: int,
    point: Array,
    num_axes: int,
    state: Array,
    work: Array,
    motion: Array,
) -> Array:
    """Returns tool_kinematics() of a plant.

    Args:
        tree: Its links.
        link: Index of the link with the tool.
        point: Where the tool is in the link's frame, m (3).
        num_axes: Number of task axes.
        state: [q; v].
        work: As make_work() returns it.
        motion: To work in (6 + 3 n).
    """
    n = len(tree.parents)
    calc_kinematics(tree, state[:n], state[n:], work)
    calc_point_motion(tree, link, point, work, motion)
    return tool_kinematics(num_axes, motion[:3], motion[6:].reshape(3, n), state)


def tool_dynamics(
    tree: RigidBodyTree,
    link: int,
    point: Array,
    num_axes: int,
    q: Array,
    v: Array,
    work: Array,
    motion: Array,
) -> Array:
    """Returns dynamics_vector() of a plant at its tool.

    Args:
        tree: Its links.
        link: Index of the link with the tool.
        point: Where the tool is in the link's frame, m (3).
        num_axes: Number of task axes.
        q: Positions of the joints in rad or m (n).
        v: Their velocities in rad/s or m/s (n).
        work: As make_work() returns it.
        motion: To work in (6 + 3 n).
    """
    n = len(q)
    bias, J_dot_qdot = np.empty(n), np.empty(3)
    calc_mass_matrix(tree, q, v, work, bias)
    calc_point_motion(tree, link, point, work, motion)
    calc_point_acceleration(tree, link, point, np.zeros(n), work, J_dot_qdot)
    J = motion[6:].reshape(3, n)[:num_axes]
    return dynamics_vector(mass_matrix(work), bias, J, J_dot_qdot[:num_axes])


def TrackingKernel(controller: NetworkTrackingController) -> Kernel:
    """Returns the kernel of the controller of chapter 3, which knows a plant.

    Args:
        controller: The block.

    Raises:
        UnsupportedSystem: If ReadPlantTree() cannot read the plant.
    """
    plant, frame, network = controller.plant, controller.tool_frame, controller.network
    plant_context = plant.CreateDefaultContext()
    read = ReadPlantTree(plant, plant_context)
    link, X_LB = read.poses[int(frame.body().index())]
    X_BF = frame.CalcPoseInBodyFrame(plant_context)
    nv, n, N = plant.num_velocities(), network.num_inputs, network.num_functions
    motion = ("tool_position", "tool_velocity", "desired_position", "desired_velocity")
    law = ("gains", "dynamics", "state", "basis", "auxiliary_error")
    return Kernel(
        parameters={
            "gains": controller.gains.as_numbers(),
            "centres": network.centres,
            "widths": network.widths,
            "tree": read.tree,
            "point": (X_LB @ X_BF).translation(),
            "work": make_work(nv),
            "motion": np.zeros(6 + 3 * nv),
        },
        rate=(weights_rate_vector, *law),
        outputs={
            "basis": (basis_functions, "tool_position", "centres", "widths"),
            "dynamics": (
                tool_dynamics, "tree", link, "point", n, "joint_position",
                "joint_velocity", "work", "motion",
            ),
            "auxiliary_error": (tracking_error, "gains", *motion),
            "control_force": (
                tracking_force_vector, *law, "tool_velocity", "desired_velocity",
                "desired_acceleration",
            ),
            "disturbance_estimate": (disturbance_estimate, "state", "basis"),
            "weights_1": "state",
        },
        sizes={"basis": N, "dynamics": n * n + n},
    )  # fmt: skip


def ToolKernel(tool: ToolInterface) -> Kernel:
    """Returns the kernel of the block between a plant and the task space.

    Args:
        tool: The block.

    Raises:
        UnsupportedSystem: If ReadPlantTree() cannot read the plant.
    """
    plant, body, num_axes = tool.plant, tool.tool_index, tool.num_task_axes
    read = ReadPlantTree(plant, plant.CreateDefaultContext())
    link, X_LB = read.poses[body]
    n = plant.num_velocities()
    return Kernel(
        parameters={
            "tree": read.tree,
            "point": X_LB.translation(),
            "work": make_work(n),
            "motion": np.zeros(6 + 3 * n),
        },
        outputs={
            "tool_kinematics": (
                tool_motion, "tree", link, "point", num_axes, "plant_state", "work",
                "motion",
            ),
            "tool_acceleration": (
                "body_spatial_accelerations", 3 * body, 3 * body + num_axes
            ),
            "joint_torques": (
                joint_torques, "control_force", "environment_force", "tool_kinematics"
            ),
        },
        sizes={"body_spatial_accelerations": 3 * plant.num_bodies()},
    )  # fmt: skip


def PlantKernel(plant: MultibodyPlant, context: Context) -> Kernel:
    """Returns the kernel of a plant, a tree of revolute and prismatic joints.

    For `body_spatial_accelerations`, which is no vector in Drake, it has the
    translational acceleration of each body's origin, by the body's index.

    Args:
        plant: A finalized, continuous plant.
        context: Its context, which has the parameters.

    Raises:
        UnsupportedSystem: If ReadPlantTree() cannot read the plant.
    """
    read = ReadPlantTree(plant, context)
    n, num_bodies = plant.num_velocities(), plant.num_bodies()
    outputs: dict[str, Term] = {
        "state": "state",
        "generalized_acceleration": ("rate", n, 2 * n),
        "body_spatial_accelerations": (
            body_accelerations, "tree", "links", "points", "rate", "work", "result"
        ),
    }  # fmt: skip
    parameters: dict[str, Any] = {
        "tree": read.tree,
        "actuated": read.actuated,
        "effort_limits": read.effort_limits,
        "links": np.array([read.poses[i][0] for i in range(num_bodies)]),
        "points": np.array([read.poses[i][1].translation() for i in range(num_bodies)]),
        "work": make_work(n),
        "forces": np.zeros(n),
        "rate_result": np.zeros(2 * n),
        "result": np.zeros(3 * num_bodies),
    }
    return Kernel(
        parameters=parameters,
        outputs=outputs,
        rate=(
            plant_rate, "tree", "actuated", "effort_limits", "state", "actuation",
            "applied_generalized_force", "work", "forces", "rate_result",
        ),
        sizes={"body_spatial_accelerations": 3 * num_bodies},
    )  # fmt: skip
