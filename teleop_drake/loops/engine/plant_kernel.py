"""The kernel of a MultibodyPlant."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.multibody import tree as multibody
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, PortDataType

from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.plant_springs import (
    ForceElements,
    IsSpring,
    ReadSprings,
    forces_with_springs,
)
from teleop_drake.loops.engine.plant_tree import NoTree, ReadPlantTree
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.kernel import Kernel, Term, Transition
from teleop_drake.loops.numerics import rigid_body
from teleop_drake.loops.numerics.rigid_body import RigidBodyTree

_CONTACT = (
    "its bodies can collide; compiled are smooth plants, and contacts at a point of a "
    "tool with the walls of this package, such as ContactWall"
)


def net_efforts(
    effort_limits: Array, selection: Array, actuation: Array, of_instances: Array
) -> Array:
    """Returns the efforts of the m actuators, N m or N (m).

    Args:
        effort_limits: The largest effort of each actuator, N m or N (m).
        selection: Assigns the k commands of model instances to actuators: 1 where a
            command belongs to an actuator, else 0 (m, k).
        actuation: The commands from the port `actuation`, N m or N (m).
        of_instances: The commands from the ports of model instances, N m or N (k).
    """
    total = actuation + selection @ of_instances
    return np.clip(total, -effort_limits, effort_limits)


def plant_rate(
    tree: RigidBodyTree,
    B: Array,
    state: Array,
    efforts: Array,
    generalized_force: Array,
) -> Array:
    """Returns the rate [v; v_dot] of a plant's state (2 n).

    Args:
        tree: The plant's links and joints.
        B: The plant's actuation matrix (n, m).
        state: The joint positions and velocities [q; v] (2 n).
        efforts: The efforts of the actuators, N m or N (m).
        generalized_force: The applied generalized forces, N m or N (n).
    """
    q, v = np.split(state, 2)
    forces = generalized_force + B @ efforts
    return np.append(v, rigid_body.calc_joint_accelerations(tree, q, v, forces))


def plant_step(
    tree: RigidBodyTree,
    B: Array,
    time_step: float,
    state: Array,
    efforts: Array,
    generalized_force: Array,
) -> Array:
    """Returns the next state of a discrete plant without contact; see plant_rate().

    Damping acts on the next velocities; all other forces are evaluated in the present
    state: (M + h D) (v_next - v) = h (forces - D v - bias), q_next = q + h v_next.

    Args:
        tree: The plant's links and joints, with h D added to the rotor inertias.
        time_step: The period h, s.
    """
    q, v = np.split(state, 2)
    rate = plant_rate(tree, B, state, efforts, generalized_force)
    v_next = v + time_step * rate[len(v) :]
    return np.append(q + time_step * v_next, v_next)


def PlantKernel(plant: MultibodyPlant, context: Context) -> Kernel:
    """Returns the kernel of a plant, a tree of links; see NoTree().

    The kernel of a discrete plant has only the outputs that are states. The plant's
    other outputs are results of its last step, which a compiled program does not store.
    It has no limits of joints, see plant_limits.

    Args:
        plant: The plant.
        context: The plant's Context, with its parameters.

    Raises:
        UnsupportedSystem: If the plant has other joints, or a force, constraint,
            contact, lock or controller that the kernel does not describe.
    """
    for reason in (*NoTree(plant), *_Obstacles(plant, context)):
        raise UnsupportedSystem(plant, reason)
    read = ReadPlantTree(plant, context)
    tree = read.tree
    instances = [
        multibody.ModelInstanceIndex(i) for i in range(plant.num_model_instances())
    ]
    commands = _Commands(plant, context, instances)
    actuators = [place for places in commands.values() for place in places]
    motors = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]
    parameters = {
        "tree": tree,
        "B": plant.MakeActuationMatrix(),
        "effort_limits": np.array([motor.effort_limit() for motor in motors], float),
        "selection": np.eye(len(motors))[:, actuators],
    }
    efforts: Term = (
        net_efforts, "effort_limits", "selection", "actuation", "commands of instances"
    )  # fmt: skip
    make = _Discrete if plant.time_step() > 0 else _Continuous
    applied = "applied_generalized_force"
    outputs: dict[str, Term] = {"commands of instances": [*commands]}
    sizes = {"commands of instances": len(actuators)}
    if any(ForceElements(plant)):
        parameters["springs"] = ReadSprings(plant, context, read)
        state = "mode" if plant.time_step() > 0 else "state"
        outputs["forces"] = (forces_with_springs, "springs", "tree", state, applied)
        sizes["forces"] = plant.num_velocities()
        applied = "forces"
    kernel = make(plant, tree, efforts, applied, instances)
    return replace(
        kernel,
        parameters={**parameters, **kernel.parameters},
        outputs=outputs | {**kernel.outputs},
        sizes=sizes | {**kernel.sizes},
        # No bodies can collide, so that the plant needs no geometry.
        unused=("geometry_query", *_IdleInputs(plant, instances)),
    )


def _Commands(
    plant: MultibodyPlant,
    context: Context,
    instances: Iterable[multibody.ModelInstanceIndex],
) -> dict[str, list[int]]:
    """Returns the actuators of each model instance whose own port is connected.

    They are keyed by the name of the port. No port stays in use: Drake 1.58 never
    releases a plant of which one port was in use twice at a time.
    """
    commands = {}
    for i in instances:
        port = plant.get_actuation_input_port(i)
        if port.size() > 0 and port.HasValue(context):
            commands[port.get_name()] = _Places(plant.GetJointActuatorIndices(i))
    return commands


def _IdleInputs(
    plant: MultibodyPlant, instances: Iterable[multibody.ModelInstanceIndex]
) -> Iterator[str]:
    """Yields the inputs that have no effect where no motor has a controller."""
    for i in instances:
        yield plant.get_desired_state_input_port(i).get_name()
    for port in InputPorts(plant):
        is_vector = port.get_data_type() == PortDataType.kVectorValued
        if is_vector and port.size() == 0:
            yield port.get_name()


def _Obstacles(plant: MultibodyPlant, context: Context) -> Iterator[str]:
    """Yields the reasons why a plant does not move as a RigidBodyTree."""
    for element in ForceElements(plant):
        if not IsSpring(element):
            yield (
                f"force element {int(element.index())} is a {type(element).__name__}, "
                "neither gravity nor a linear spring"
            )
    if plant.num_constraints() > 0:
        yield "it has constraints"
    if plant.num_collision_geometries() > 0:
        # Collision filters of the SceneGraph may exclude all pairs of bodies.
        port = plant.get_geometry_query_input_port()
        is_known = port.HasValue(context)
        if not is_known or port.Eval(context).inspector().GetCollisionCandidates():
            yield _CONTACT
    for joint_index in plant.GetJointIndices():
        joint = plant.get_joint(joint_index)
        if joint.is_locked(context):
            yield f"joint {joint.name()} is locked"
    for actuator_index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(actuator_index)
        if actuator.has_controller():
            yield f"actuator {actuator.name()} has a controller"


def _Continuous(
    plant: MultibodyPlant,
    tree: RigidBodyTree,
    efforts: Term,
    applied: str,
    instances: list[multibody.ModelInstanceIndex],
) -> Kernel:
    """Returns the kernel of a continuous plant without the commands of its actuators.

    Args:
        efforts: The term of the actuators' efforts.
        applied: The name of the applied generalized forces, with those of springs.
        instances: The model instances of the plant.
    """
    n = plant.num_velocities()
    outputs: dict[str, Term] = {
        "state": "state",
        "net_actuation": efforts,
        "generalized_acceleration": ("rate", n, 2 * n),
    }
    # The outputs of each model instance are elements of those of the plant.
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
        parameters={"no_contact": np.zeros(n)},
        outputs=outputs,
        rate=(
            plant_rate, "tree", "B", "state", "net_actuation", applied,
        ),
    )  # fmt: skip


def _Discrete(
    plant: MultibodyPlant,
    tree: RigidBodyTree,
    efforts: Term,
    applied: str,
    instances: list[multibody.ModelInstanceIndex],
) -> Kernel:
    """Returns the kernel of a discrete plant; see _Continuous()."""
    h = plant.time_step()
    # The damping D of the joints acts as an inertia h D; see plant_step().
    rotors = tree.rotor_inertias + h * tree.damping
    step = Transition(
        mode=(
            plant_step, "tree", "B", "time_step", "mode", "efforts", applied,
        ),
        period=h,
        is_discrete=not plant.has_sampled_output_ports(),
    )  # fmt: skip
    outputs: dict[str, Term] = {"state": "mode", "efforts": efforts}
    for i in instances:
        name = plant.GetModelInstanceName(i)
        outputs[f"{name}_state"] = _Elements("mode", _StatesOf(plant, i))
    return Kernel(
        parameters={"tree": tree._replace(rotor_inertias=rotors), "time_step": h},
        outputs=outputs,
        transitions={"steps": step},
        sizes={"efforts": plant.num_actuators()},
    )


def _StatesOf(
    plant: MultibodyPlant, instance: multibody.ModelInstanceIndex
) -> list[int]:
    """Returns the indices of a model instance's q and v in the state of its plant."""
    n = plant.num_velocities()
    places = np.arange(float(n))
    q = plant.GetPositionsFromArray(instance, places)
    v = plant.GetVelocitiesFromArray(instance, places)
    return _Places([*q, *(n + v)])


def _Places(numbers: Iterable[Any]) -> list[int]:
    return [int(number) for number in numbers]


def _Elements(name: str, places: list[int]) -> Term:
    """Returns the term of the elements of a vector at some indices."""
    return [(name, i, i + 1) for i in places]
