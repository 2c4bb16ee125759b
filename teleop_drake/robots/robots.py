"""The robots: SDF models, their start poses, and their place in task space."""

import difflib
import math
import xml.etree.ElementTree as ET
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import Demultiplexer

from teleop_drake.systems.tool_interface import ToolInterface

# Each model has a file of its name in models/, whose body `tool` marks the tool T.
_NUM_TASK_AXES = {"slider": 1, "two_link_arm": 2}

# Sign of q2, the bend of the elbow. Stretched forward along x, `down` puts the elbow
# at y < 0.
_ELBOW_SIGNS = {"up": -1.0, "down": 1.0}

# The arm must not start closer to a singularity than this |sin(q2)|; the determinant
# of its Jacobian is L1 L3 sin(q2).
_MINIMUM_ELBOW_SINE = 0.05


def RobotModels() -> tuple[str, ...]:
    """Returns the names of the robot models."""
    return tuple(_NUM_TASK_AXES)


def NumTaskAxes(model: str) -> int:
    """Returns n, the number of axes of the model's task space.

    Raises:
        ValueError: If there is no such model.
    """
    if model not in _NUM_TASK_AXES:
        close = difflib.get_close_matches(str(model), _NUM_TASK_AXES, n=1, cutoff=0.5)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise ValueError(
            f"robot.model: {model!r} is not one of {', '.join(_NUM_TASK_AXES)}{hint}"
        )
    return _NUM_TASK_AXES[model]


def CheckRobot(
    *,
    model: str,
    start: ArrayLike,
    elbow: str | None = None,
    mass: float | None = None,
    damping: float | None = None,
) -> None:
    """Checks the parameters of `MakeRobot` without making the robot.

    Raises:
        ValueError: In one line, with the field, its value and what is allowed.
    """
    _CheckOverrides(model, mass, damping)
    InverseKinematics(model, start, elbow)


def LoadRobotPlant(
    model: str,
    *,
    mass: float | None = None,
    damping: float | None = None,
    gravity: ArrayLike | None = None,
) -> MultibodyPlant:
    """Loads a model into a continuous, finalized MultibodyPlant named `plant`.

    Args:
        model: One of `RobotModels()`.
        mass: Mass of the slider's carriage, kg; None keeps the model's. Slider only.
        damping: Viscous damping of the slider's rail, N s/m; None keeps the model's.
            Slider only.
        gravity: Acceleration of gravity along the task axes, m/s^2 (n); None keeps
            Drake's, across the plane in which the robots move.

    Raises:
        ValueError: If there is no such model or it cannot take an override.
    """
    _CheckOverrides(model, mass, damping)
    file = resources.files("teleop_drake") / "models" / f"{model}.sdf"
    sdf = ET.fromstring(file.read_text(encoding="utf-8"))
    # Overrides go into the model's text, and so into every context of the plant.
    for value, path in (
        (mass, ".//link[@name='carriage']/inertial/mass"),
        (damping, ".//joint[@name='rail']/axis/dynamics/damping"),
    ):
        if value is not None:
            element = sdf.find(path)
            assert element is not None
            element.text = repr(float(value))
    plant = MultibodyPlant(time_step=0.0)
    plant.set_name("plant")
    Parser(plant).AddModelsFromString(ET.tostring(sdf, encoding="unicode"), "sdf")
    if gravity is not None:
        gravity_W = np.zeros(3)
        gravity_W[: NumTaskAxes(model)] = gravity
        plant.mutable_gravity_field().set_gravity_vector(gravity_W)
    plant.Finalize()
    return plant


def InverseKinematics(
    model: str, p_WT: ArrayLike, elbow: str | None = None
) -> np.ndarray:
    """Returns the joint positions that put the tool at a point, (A.14).

    Args:
        model: One of `RobotModels()`.
        p_WT: Position of the tool, m (n).
        elbow: Which of two_link_arm's two solutions: `up` (q2 < 0) or `down` (q2 > 0,
            at (0.85, 0) the one with the elbow at y < 0). None for the slider.

    Returns:
        q (nq), in m or rad.

    Raises:
        ValueError: If a parameter does not fit the model or the point is out of its
            reach: two_link_arm keeps |sin(q2)| >= 0.05, away from its singular poses,
            stretched and folded. The message names the field of a scenario,
            `robot.start` for `p_WT`.
    """
    n = NumTaskAxes(model)
    try:
        p = np.array(p_WT, dtype=float)
    except (TypeError, ValueError):
        p = np.array(np.nan)
    if p.shape != (n,) or not np.isfinite(p).all():
        plural = "s" if n > 1 else ""
        raise ValueError(
            f"robot.start: {_Show(p_WT)} must be a list of {n} finite number{plural} "
            f"(m) for {model}"
        )
    if model == "slider":
        if elbow is not None:
            raise ValueError(f"robot.elbow: {elbow!r} must be null; a slider has none")
        return p
    if elbow not in _ELBOW_SIGNS:
        raise ValueError(
            f"robot.elbow: {elbow!r} must be {' or '.join(_ELBOW_SIGNS)} for {model}"
        )

    L1, L3 = _LinkLengths()
    cosine_limit = math.sqrt(1 - _MINIMUM_ELBOW_SINE**2)
    reach = math.hypot(*p)
    nearest, farthest = (
        math.sqrt(L1**2 + L3**2 + sign * 2 * L1 * L3 * cosine_limit) for sign in (-1, 1)
    )
    if not nearest <= reach <= farthest:
        raise ValueError(
            f"robot.start: {_Show(p_WT)} is {reach:.6g} m from the shoulder of "
            f"{model}; allowed is {nearest:.6g} to {farthest:.6g} m"
        )
    c2 = (reach**2 - L1**2 - L3**2) / (2 * L1 * L3)
    s2 = _ELBOW_SIGNS[elbow] * math.sqrt(1 - c2**2)
    q1 = math.atan2(p[1], p[0]) - math.atan2(L3 * s2, L1 + L3 * c2)
    return np.array([q1, math.atan2(s2, c2)])


def TaskInertiaInverse(
    *,
    model: str,
    start: ArrayLike,
    elbow: str | None = None,
    mass: float | None = None,
) -> np.ndarray:
    """Returns M_r^-1 = J M^-1 J^T, the inverse of (2.8), at a start pose.

    Args:
        model: One of `RobotModels()`.
        start: Position of the tool, m (n).
        elbow: As for `InverseKinematics`.
        mass: As for `LoadRobotPlant`, kg.

    Returns:
        The inverse of the inertia felt at the tool, 1/kg (n x n), by Drake.

    Raises:
        ValueError: If a parameter does not fit the model.
    """
    plant = LoadRobotPlant(model, mass=mass)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, InverseKinematics(model, start, elbow))
    Jv_v_WT = _ToolJacobian(plant, context)
    return Jv_v_WT @ np.linalg.solve(plant.CalcMassMatrix(context), Jv_v_WT.T)


def TaskDamping(
    *,
    model: str,
    start: ArrayLike,
    elbow: str | None = None,
    damping: float | None = None,
) -> np.ndarray:
    """Returns J^-T D J^-1, the damping of the joints felt at the tool at a start pose.

    Args:
        model: One of `RobotModels()`.
        start: Position of the tool, m (n).
        elbow: As for `InverseKinematics`.
        damping: As for `LoadRobotPlant`, N s/m.

    Returns:
        The damping in N s/m (n x n).

    Raises:
        ValueError: If a parameter does not fit the model.
    """
    plant = LoadRobotPlant(model, damping=damping)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, InverseKinematics(model, start, elbow))
    D = np.diag(
        [
            plant.get_joint(index).default_damping_vector()[0]
            for index in plant.GetJointIndices()
            if plant.get_joint(index).num_velocities() == 1
        ]
    )
    J_inverse = np.linalg.inv(_ToolJacobian(plant, context))
    return J_inverse.T @ D @ J_inverse


def _ToolJacobian(plant: MultibodyPlant, context: Context) -> np.ndarray:
    """Returns Jv_v_WT (n, n) along the task axes."""
    world = plant.world_frame()
    return plant.CalcJacobianTranslationalVelocity(
        context,
        JacobianWrtVariable.kV,
        plant.GetFrameByName("tool"),
        np.zeros(3),
        world,
        world,
    )[: plant.num_velocities()]


def MakeRobot(
    *,
    model: str,
    start: ArrayLike,
    elbow: str | None = None,
    mass: float | None = None,
    damping: float | None = None,
    gravity: ArrayLike | None = None,
) -> Diagram:
    """Makes the robot: forces on its tool in, motion of its tool out (2.6, 2.7).

    The Diagram, named `robot`, holds the MultibodyPlant `plant`, the ToolInterface
    `tool_interface`, and `joint_state`, `tool_motion` and `joint_torques`, which split
    signals. Its default context is at rest at the start pose.

    Input ports:

    | name              | size | unit                                              |
    |-------------------|------|---------------------------------------------------|
    | control_force     | n    | N                                                 |
    | environment_force | n    | N, force of the robot ON the environment          |

    Output ports:

    | name              | size | unit         | direct feedthrough from             |
    |-------------------|------|--------------|-------------------------------------|
    | tool_position     | n    | m            | none                                |
    | tool_velocity     | n    | m/s          | none                                |
    | tool_acceleration | n    | m/s^2        | both forces; costs a forward        |
    |                   |      |              | dynamics, meant for recordings      |
    | joint_position    | nq   | rad or m     | none                                |
    | joint_velocity    | nv   | rad/s or m/s | none                                |
    | joint_torque      | nv   | N m or N     | both forces, in form; it depends on |
    |                   |      |              | control_force alone                 |

    Args:
        model: One of `RobotModels()`.
        start: Position of the tool at the start, m (n).
        elbow: As for `InverseKinematics`.
        mass: As for `LoadRobotPlant`, kg.
        damping: As for `LoadRobotPlant`, N s/m.
        gravity: As for `LoadRobotPlant`, m/s^2.

    Raises:
        ValueError: If a parameter does not fit the model.
    """
    q = InverseKinematics(model, start, elbow)
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem(
        "plant",
        LoadRobotPlant(model, mass=mass, damping=damping, gravity=gravity),
    )
    plant.SetDefaultPositions(q)
    n = NumTaskAxes(model)
    tool = builder.AddNamedSystem(
        "tool_interface", ToolInterface(plant=plant, num_task_axes=n)
    )
    nq, nv = plant.num_positions(), plant.num_velocities()
    motion = builder.AddNamedSystem("tool_motion", Demultiplexer([n, n, n * nv]))
    joints = builder.AddNamedSystem("joint_state", Demultiplexer([nq, nv]))
    state = plant.get_state_output_port()
    builder.Connect(state, joints.get_input_port())
    builder.Connect(state, tool.GetInputPort("plant_state"))
    builder.Connect(
        plant.get_body_spatial_accelerations_output_port(),
        tool.GetInputPort("body_spatial_accelerations"),
    )
    torques = builder.AddNamedSystem("joint_torques", Demultiplexer([nv, nv]))
    builder.Connect(tool.GetOutputPort("joint_torques"), torques.get_input_port())
    builder.Connect(torques.get_output_port(0), plant.get_actuation_input_port())
    builder.Connect(
        torques.get_output_port(1),
        plant.get_applied_generalized_force_input_port(),
    )
    for name in ("control_force", "environment_force"):
        builder.ExportInput(tool.GetInputPort(name), name)
    builder.Connect(tool.GetOutputPort("tool_kinematics"), motion.get_input_port())
    builder.ExportOutput(motion.get_output_port(0), "tool_position")
    builder.ExportOutput(motion.get_output_port(1), "tool_velocity")
    builder.ExportOutput(tool.GetOutputPort("tool_acceleration"), "tool_acceleration")
    builder.ExportOutput(joints.get_output_port(0), "joint_position")
    builder.ExportOutput(joints.get_output_port(1), "joint_velocity")
    builder.ExportOutput(torques.get_output_port(0), "joint_torque")
    robot = builder.Build()
    robot.set_name("robot")
    return robot


def _CheckOverrides(model: str, mass: float | None, damping: float | None) -> None:
    """Raises ValueError unless the model can take this mass and damping."""
    NumTaskAxes(model)
    for field, value in (("mass", mass), ("damping", damping)):
        if value is not None and model != "slider":
            raise ValueError(
                f"robot.{field}: {value!r} must be null for {model}; only a slider's "
                "can be set"
            )
    if mass is not None and not 0 < mass < math.inf:
        raise ValueError(f"robot.mass: {mass!r} must be finite and > 0 kg")
    if damping is not None and not 0 <= damping < math.inf:
        raise ValueError(f"robot.damping: {damping!r} must be finite and >= 0 N s/m")


def _LinkLengths() -> tuple[float, float]:
    """Returns the two_link_arm's L1 and L3 in m, as its model file has them."""
    plant = LoadRobotPlant("two_link_arm")
    context = plant.CreateDefaultContext()
    elbow, tool = (
        plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name)).translation()
        for name in ("lower_link", "tool")
    )
    # At q = 0 the arm lies stretched along x.
    return elbow[0], tool[0] - elbow[0]


def _Show(value: ArrayLike) -> str:
    """Shows what was given as one short line."""
    return str(value.tolist() if isinstance(value, np.ndarray) else value)
