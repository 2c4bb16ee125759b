"""The kernels of a MultibodyPlant, and of what asks one."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, System

from teleop_drake.arrays import Array, Indices
from teleop_drake.blocks.systems.gravity_compensation import GravityCompensation
from teleop_drake.blocks.systems.network_tracking_controller import (
    NetworkTrackingController,
)
from teleop_drake.blocks.systems.posture_hold import PostureHold
from teleop_drake.blocks.systems.tool_interface import ToolInterface
from teleop_drake.engine.plant_tree import PlantTree, ReadPlantTree
from teleop_drake.kernel import Kernel, Term, Transition
from teleop_drake.laws import task_space, tracking
from teleop_drake.laws.gaussian_network import basis_functions
from teleop_drake.laws.task_space import PostureGains
from teleop_drake.numerics import rigid_body
from teleop_drake.numerics.rigid_body import RigidBodyTree


class Tool(NamedTuple):
    """A tool on a plant's link.

    Attributes:
        tree: The links.
        link: Index of the link with the tool.
        pose: [R, p] of the tool in the link's frame (3, 4), m.
    """

    tree: RigidBodyTree
    link: int
    pose: Array


class _ToolState(NamedTuple):
    """A plant and its tool at an instant; see rigid_body.calc_dynamics() for M."""

    R: Array
    J: Array
    M: Array
    bias: Array
    acceleration: Array


def _at_tool(tool: Tool, q: Array, v: Array) -> _ToolState:
    """Returns the dynamics at a tool; the acceleration is that without v_dot."""
    tree, link, pose = tool
    point = pose[:, 3]
    motion = rigid_body.calc_motion(tree, q, v)
    R = motion.R[link + 1] @ pose[:, :3]
    _, J = rigid_body.calc_jacobian(tree, motion, link, point)
    M, bias = rigid_body.calc_dynamics(tree, motion, v)
    rest = np.zeros(len(v))
    a = rigid_body.calc_point_accelerations(tree, motion, [link], [point], v, rest)
    return _ToolState(R, J, M, bias, a[0])


def net_efforts(
    effort_limits: Array, actuators: Indices, actuation: Array, of_instances: Array
) -> Array:
    """Returns the efforts of the actuators, N m or N.

    Args:
        effort_limits: The largest effort of each actuator, N m or N.
        actuators: The actuator that each element of `of_instances` belongs to.
        actuation: The command to all actuators, N m or N.
        of_instances: The commands to those of model instances, N m or N.
    """
    total = actuation.copy()
    for k in range(len(actuators)):
        total[actuators[k]] += of_instances[k]
    return np.clip(total, -effort_limits, effort_limits)


def plant_rate(
    tree: RigidBodyTree,
    actuated: Indices,
    state: Array,
    efforts: Array,
    generalized_force: Array,
) -> Array:
    """Returns [v; v_dot] of a plant.

    Args:
        actuated: The velocity that each actuator acts on.
        efforts: Of the actuators, N m or N.
        generalized_force: What else acts on the joints, N m or N (n).
    """
    q, v = np.split(state, 2)
    forces = generalized_force.copy()
    for k in range(len(actuated)):
        forces[actuated[k]] += efforts[k]
    return np.append(v, rigid_body.calc_joint_accelerations(tree, q, v, forces))


def plant_step(
    tree: RigidBodyTree,
    actuated: Indices,
    time_step: float,
    state: Array,
    efforts: Array,
    generalized_force: Array,
) -> Array:
    """Returns the next state of a discrete plant without contact; see plant_rate().

    Damping acts on the next velocities, all else is that of the present state:
    (M + h D) (v_next - v) = h (forces - D v - bias), q_next = q + h v_next.

    Args:
        tree: The links, whose rotors have the inertia h D besides their own.
        time_step: The period h, s.
    """
    q, v = np.split(state, 2)
    rate = plant_rate(tree, actuated, state, efforts, generalized_force)
    v_next = v + time_step * rate[len(v) :]
    return np.append(q + time_step * v_next, v_next)


def body_accelerations(
    tree: RigidBodyTree,
    links: Indices,
    points: Array,
    state: Array,
    rate: Array,
) -> Array:
    """Returns [acceleration; angular acceleration] of points of links (6 k).

    Args:
        links: Index of the link that each point belongs to.
        points: The points in the links' frames, m (k, 3).
        rate: What plant_rate() returns.
    """
    q, v = np.split(state, 2)
    motion = rigid_body.calc_motion(tree, q, v)
    v_dot = rate[len(v) :]
    a = rigid_body.calc_point_accelerations(tree, motion, links, points, v, v_dot)
    return a.ravel()


def tool_motion(tool: Tool, num_axes: int, R_WP: Array, state: Array) -> Array:
    """Returns task_space.tool_kinematics() of a plant whose state is [q; v]."""
    q, v = np.split(state, 2)
    motion = rigid_body.calc_motion(tool.tree, q, v)
    p, J = rigid_body.calc_jacobian(tool.tree, motion, tool.link, tool.pose[:, 3])
    R = motion.R[tool.link + 1] @ tool.pose[:, :3]
    X_WT = np.concatenate((R, p.reshape(3, 1)), axis=1)
    return task_space.tool_kinematics(num_axes, R_WP, X_WT, J, state)


def tool_dynamics(tool: Tool, num_axes: int, q: Array, v: Array) -> Array:
    """Returns tracking.task_dynamics() of a plant at its tool."""
    at = _at_tool(tool, q, v)
    J = at.J[3 : 3 + num_axes]
    return tracking.task_dynamics(at.M, at.bias, J, at.acceleration[:num_axes])


def gravity_torque(tree: RigidBodyTree, state: Array) -> Array:
    """Returns what carries the weight of a plant at rest, N m or N (n)."""
    q, v = np.split(state, 2)
    rest = 0.0 * v
    motion = rigid_body.calc_motion(tree, q, rest)
    return rigid_body.calc_dynamics(tree, motion, rest)[1]


def hold_torque(
    tool: Tool,
    num_axes: int,
    gains: PostureGains,
    held: tuple[Array, ...],
    state: Array,
) -> Array:
    """Returns the torque that holds what the task leaves free of a plant, N m or N (n).

    Args:
        held: q_0, see task_space.posture_torque(); or q_0 and R_0, see
            task_space.orientation_torque().
        state: [q; v].
    """
    q, v = np.split(state, 2)
    at = _at_tool(tool, q, v)
    J_w = at.J[:3]
    J_v = at.J[3:]
    if len(held) == 1:
        J = np.concatenate((J_v, J_w))[:num_axes]
        return task_space.posture_torque(gains, at.M, J, held[0], q, v)
    q_0, R_0 = held
    J_v = J_v[:num_axes]
    return task_space.orientation_torque(gains, at.M, J_v, J_w, R_0, at.R, q_0, q, v)


def _ReadTool(
    plant: MultibodyPlant, body: int, X_BT: RigidTransform | None = None
) -> Tool:
    """Returns the tool on a body, at its origin or at a pose.

    Raises:
        UnsupportedSystem: If ReadPlantTree() cannot read the plant.
    """
    read = ReadPlantTree(plant, plant.CreateDefaultContext())
    link, X_LB = read.poses[body]
    return Tool(read.tree, link, (X_LB @ (X_BT or RigidTransform())).GetAsMatrix34())


def TrackingKernel(controller: NetworkTrackingController) -> Kernel:
    """Returns the kernel of the controller of chapter 3, which knows a plant."""
    plant = controller.plant
    frame = controller.tool_frame
    network = controller.network
    X_BF = frame.CalcPoseInBodyFrame(plant.CreateDefaultContext())
    n = network.num_inputs
    motion = ("tool_position", "tool_velocity", "desired_position", "desired_velocity")
    law = ("gains", "dynamics", "state", "basis", "auxiliary_error")
    return Kernel(
        parameters={
            "gains": controller.gains.as_numbers(),
            "centres": network.centres,
            "widths": network.widths,
            "tool": _ReadTool(plant, int(frame.body().index()), X_BF),
        },
        rate=(tracking.weights_rate, *law),
        outputs={
            "basis": (basis_functions, "tool_position", "centres", "widths"),
            "dynamics": (tool_dynamics, "tool", n, "joint_position", "joint_velocity"),
            "auxiliary_error": (tracking.tracking_error, "gains", *motion),
            "control_force": (
                tracking.tracking_force, *law, "tool_velocity", "desired_velocity",
                "desired_acceleration",
            ),
            "disturbance_estimate": (tracking.disturbance_estimate, "state", "basis"),
            "weights_1": "state",
        },
        sizes={"basis": network.num_functions, "dynamics": n * n + n},
    )  # fmt: skip


def ToolKernel(block: ToolInterface) -> Kernel:
    """Returns the kernel of the block between a plant and the task space."""
    body = block.tool_index
    num_axes = block.num_task_axes
    return Kernel(
        parameters={"tool": _ReadTool(block.plant, body), "R_WP": block.R_WP},
        outputs={
            "tool_kinematics": (tool_motion, "tool", num_axes, "R_WP", "plant_state"),
            "tool_acceleration": (
                "body_spatial_accelerations", 6 * body, 6 * body + num_axes
            ),
            "joint_torques": (
                task_space.joint_torques, "control_force", "environment_force",
                "tool_kinematics",
            ),
        },
        sizes={"body_spatial_accelerations": 6 * block.plant.num_bodies()},
    )  # fmt: skip


def GravityKernel(block: GravityCompensation) -> Kernel:
    """Returns the kernel of the block that carries an arm's weight."""
    model = block.model
    return Kernel(
        parameters={"tree": ReadPlantTree(model, model.CreateDefaultContext()).tree},
        outputs={"gravity_torque": (gravity_torque, "tree", "plant_state")},
    )


def HoldKernel(block: PostureHold) -> Kernel:
    """Returns the kernel of the block that holds what the task leaves free."""
    return Kernel(
        parameters={
            "tool": _ReadTool(block.plant, block.tool_index),
            "gains": block.gains,
            "held": tuple(x for x in block.held if x is not None),
        },
        outputs={
            "hold_torque": (
                hold_torque, "tool", block.num_axes, "gains", "held", "plant_state"
            ),
        },
    )  # fmt: skip


KERNELS_OF_PLANTS: dict[type[System], Callable[[Any], Kernel]] = {
    ToolInterface: ToolKernel,
    NetworkTrackingController: TrackingKernel,
    PostureHold: HoldKernel,
    GravityCompensation: GravityKernel,
}
"""Of blocks that ask a plant."""


def PlantKernel(plant: MultibodyPlant, context: Context) -> Kernel:
    """Returns the kernel of a plant, a tree of revolute and prismatic joints.

    For `body_spatial_accelerations`, which is no vector in Drake, it has the
    translational and the angular acceleration of each body, by the body's index.

    Of a discrete plant it has the states alone. The other outputs hold what was
    computed in the last step, and a compiled program does not store that.

    Args:
        context: Its context, which has the parameters.

    Raises:
        UnsupportedSystem: If ReadPlantTree() cannot read the plant.
    """
    read = ReadPlantTree(plant, context)
    instances = [ModelInstanceIndex(i) for i in range(plant.num_model_instances())]
    commands: dict[str, list[int]] = {}
    for i in instances:  # One may have its own input of commands.
        port = plant.get_actuation_input_port(i)
        if port.size() > 0 and port.HasValue(context):
            commands[port.get_name()] = _Places(plant.GetJointActuatorIndices(i))
    actuators = [place for places in commands.values() for place in places]
    parameters = {
        "tree": read.tree,
        "actuated": read.actuated,
        "effort_limits": read.effort_limits,
        "actuators": np.array(actuators, np.int64),
    }
    efforts: Term = (
        net_efforts, "effort_limits", "actuators", "actuation", "commands of instances"
    )  # fmt: skip
    make = _Discrete if plant.time_step() > 0 else _Continuous
    kernel = make(plant, read, efforts, instances)
    return replace(
        kernel,
        parameters={**parameters, **kernel.parameters},
        outputs={"commands of instances": [*commands], **kernel.outputs},
        sizes={"commands of instances": len(actuators), **kernel.sizes},
        # Without collision geometries nothing depends on it.
        unused=("geometry_query",),
    )


def _Continuous(
    plant: MultibodyPlant,
    read: PlantTree,
    efforts: Term,
    instances: list[ModelInstanceIndex],
) -> Kernel:
    """Returns what a continuous plant has besides the inputs of its actuators."""
    n = plant.num_velocities()
    num_bodies = plant.num_bodies()
    poses = [read.poses[i] for i in range(num_bodies)]
    outputs: dict[str, Term] = {
        "state": "state",
        "net_actuation": efforts,
        "generalized_acceleration": ("rate", n, 2 * n),
        "body_spatial_accelerations": (
            body_accelerations, "tree", "links", "points", "state", "rate"
        ),
    }  # fmt: skip
    for i in instances:
        name = plant.GetModelInstanceName(i)
        states = _StatesOf(plant, i)
        velocities = states[len(states) // 2 :]
        actuators = _Places(plant.GetJointActuatorIndices(i))
        outputs |= {
            f"{name}_state": _Elements("state", states),
            f"{name}_generalized_acceleration": _Elements("rate", velocities),
            f"{name}_generalized_contact_forces": ("no_contact", 0, len(velocities)),
            f"{name}_net_actuation": _Elements("net_actuation", actuators),
        }
    return Kernel(
        parameters={
            "links": np.array([link for link, _ in poses]),
            "points": np.array([X_LB.translation() for _, X_LB in poses]),
            "no_contact": np.zeros(n),
        },
        outputs=outputs,
        rate=(
            plant_rate, "tree", "actuated", "state", "net_actuation",
            "applied_generalized_force",
        ),
        sizes={"body_spatial_accelerations": 6 * num_bodies},
    )  # fmt: skip


def _Discrete(
    plant: MultibodyPlant,
    read: PlantTree,
    efforts: Term,
    instances: list[ModelInstanceIndex],
) -> Kernel:
    """Returns what a discrete plant has besides the inputs of its actuators."""
    h = plant.time_step()
    rotors = read.tree.rotor_inertias + h * read.tree.damping
    step = Transition(
        mode=(
            plant_step, "tree", "actuated", "time_step", "mode", "efforts",
            "applied_generalized_force",
        ),
        period=h,
        is_discrete=not plant.has_sampled_output_ports(),
    )  # fmt: skip
    outputs: dict[str, Term] = {"state": "mode", "efforts": efforts}
    for i in instances:
        name = plant.GetModelInstanceName(i)
        outputs[f"{name}_state"] = _Elements("mode", _StatesOf(plant, i))
    tree = read.tree._replace(rotor_inertias=rotors)
    return Kernel(
        parameters={"tree": tree, "time_step": h},
        outputs=outputs,
        transitions={"steps": step},
        sizes={"efforts": plant.num_actuators()},
    )


def _StatesOf(plant: MultibodyPlant, instance: ModelInstanceIndex) -> list[int]:
    """Returns the places of a model instance's q and v in the state of its plant."""
    n = plant.num_velocities()
    places = np.arange(float(n))
    q = plant.GetPositionsFromArray(instance, places)
    v = plant.GetVelocitiesFromArray(instance, places)
    return _Places([*q, *(n + v)])


def _Places(numbers: Iterable[Any]) -> list[int]:
    return [int(number) for number in numbers]


def _Elements(name: str, places: list[int]) -> Term:
    """Returns the term of some elements of a vector."""
    return [(name, i, i + 1) for i in places]
