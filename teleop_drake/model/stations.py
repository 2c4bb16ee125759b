"""The two ends of the loop: the master station and the slave station (Fig. 2.1).

A control architecture is a pair of systems: a master side, which MakeMasterStation puts
between the operator and the channels, and a slave side, which is the station at the
robot. Through the channels they exchange packets only. Each architecture defines the
contents of its packets; those of the thesis are

    forward packet [F_h; v_d] (2n)      return packet [p_WT; v_WT] (2n)

CheckPorts and AsChannel check a user's replacement for one of the systems.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import Demultiplexer, Multiplexer, PassThrough

from teleop_drake.loops.framework.validation import Refuse, ScenarioError
from teleop_drake.loops.framework.wiring import Connections, OutputNames, Wire
from teleop_drake.model.blocks.architectures import (
    Architecture,
    Facts,
)
from teleop_drake.model.blocks.architectures.base import LAW_INPUTS, MakeLawArchitecture
from teleop_drake.model.blocks.architectures.base import (
    MakeSlaveStation as MakeSlaveStation,
)
from teleop_drake.model.blocks.architectures.own_law import FunctionLaw, Law
from teleop_drake.model.blocks.environments import CONTACT, FindSurface, Surface
from teleop_drake.model.blocks.systems.actuator import Actuator
from teleop_drake.model.blocks.systems.sampled_sensor import SampledSensor
from teleop_drake.model.scenario import Scenario


def MakeMasterStation(
    scenario: Scenario,
    master_side: System | None = None,
    *,
    surfaces: Sequence[Surface] | None = None,
    operator: System | None = None,
    haptic_device: System | None = None,
) -> Diagram:
    """Makes the operator, the haptic device and the master side, named `master`.

    | port | name           | size | unit                             |
    |------|----------------|------|----------------------------------|
    | in   | return_packet  | m_r  | of the packet; thesis [m; m/s]   |
    | out  | forward_packet | m_f  | of the packet; thesis [N; m/s]   |
    | out  | surgeon_mode   | 1    | see ModalOperator                      |

    A master side computes the forward packet from the operator's force and velocity
    command, and the felt motion from the return packet. With a master side, the station
    has further outputs: felt_position (n, m), felt_velocity (n, m/s), velocity_command
    (n, m/s), force_command (n, N) and every other output of the master side (its
    telemetry), under its own name.

    Args:
        scenario: The scenario, of which the fields robot, surgeon, haptic_device and
            environment are used.
        master_side: A system with the inputs haptic_force (n, N: the force that the
            operator applies), velocity_command (n, m/s) and return_packet (m_r) and the
            outputs felt_position (n, m), felt_velocity (n, m/s) and forward_packet
            (m_f). None: the thesis's packets, [F_h; v_d] sent and [p_WT; v_WT] felt.
        surfaces: The surfaces of the environment, with which the operator perceives
            contact; None: the scenario's.
        operator: An operator that replaces the scenario's; see
            OperatorConfig.MakeOperator for its ports.
        haptic_device: A device that replaces the scenario's, with the inputs
            velocity_command and felt_velocity and the output haptic_force (n each). It
            may lack inputs.

    Raises:
        ValueError: If a parameter is not allowed, or a port does not have n entries.
        RuntimeError: If a system lacks one of these ports.
    """
    n = scenario.num_axes
    if surfaces is None:
        surfaces = scenario.Surfaces()
    operator = operator or scenario.surgeon.MakeOperator(
        start=scenario.robot.start, contact_surface=FindSurface(surfaces, CONTACT)
    )
    operator.set_name("surgeon")
    device = haptic_device or scenario.haptic_device.MakeDevice(n)
    device.set_name("haptic_device")
    systems = {"surgeon": operator, "haptic_device": device}
    outputs = {"surgeon_mode": "surgeon.mode"}
    # The ports of the master side. Without one, two blocks pack and unpack the packets.
    ports = {
        "haptic_force": "pack.u0",
        "velocity_command": "pack.u1",
        "return_packet": "unpack",
        "felt_position": "unpack.y0",
        "felt_velocity": "unpack.y1",
        "forward_packet": "pack",
    }
    if master_side is None:
        systems |= {"unpack": Demultiplexer([n, n]), "pack": Multiplexer([n, n])}
    else:
        systems["master_side"] = master_side
        ports = {name: f"master_side.{name}" for name in ports}
        outputs["velocity_command"] = "surgeon.velocity_command"
        outputs["force_command"] = "surgeon.force_command"
        names = OutputNames(master_side)
        telemetry = {name: f"master_side.{name}" for name in names}
        telemetry.pop("forward_packet", None)
        outputs |= telemetry
    connections = {
        "surgeon.felt_position": ports["felt_position"],
        "surgeon.felt_velocity": ports["felt_velocity"],
        "haptic_device.felt_velocity": ports["felt_velocity"],
        "haptic_device.velocity_command": "surgeon.velocity_command",
        "surgeon.haptic_force": "haptic_device.haptic_force",
    }
    for target in list(connections):  # Operator and device may lack inputs.
        name, _, port = target.partition(".")
        if not systems[name].HasInputPort(port):
            del connections[target]
    connections[ports["haptic_force"]] = "surgeon.force_command"
    connections[ports["velocity_command"]] = "surgeon.velocity_command"
    return Wire(
        Diagram(),
        "master",
        systems,
        inputs={"return_packet": [ports["return_packet"]]},
        connections=connections,
        outputs={"forward_packet": ports["forward_packet"], **outputs},
    )


def MakeArchitecture(
    scenario: Scenario,
    *,
    control_law: System | Law | None = None,
    facts: Facts | None = None,
) -> Architecture:
    """Makes the architecture that the scenario names.

    Args:
        control_law: A control law that replaces the scenario's and uses the thesis's
            packets: a system, see MakeSlaveStation, or a function, see FunctionLaw.
        facts: The facts of the loop from which defaults derive; None: the scenario's.

    Raises:
        ScenarioError: If a parameter is not allowed, or a default cannot be derived.
        ScenarioError: If the control law lacks a port, or a port has another width.
    """
    facts = facts or scenario.Facts()
    if control_law is not None:
        law = control_law
        if not isinstance(law, (System, type)):
            if not callable(law):
                Refuse("control_law", law, "a system or a function")
            law = FunctionLaw(law, facts.start)
        n = facts.num_axes
        inputs = dict.fromkeys(LAW_INPUTS, n)
        CheckPorts(
            "control_law", law, inputs=inputs, outputs={"control_force": n}, num_axes=n
        )
        return MakeLawArchitecture(law, facts.start.tolist())
    return scenario.controller.Chosen().MakeArchitecture(
        facts, scenario.controller.path
    )


def WithDrivesAndSensors(slave_side: System, scenario: Scenario) -> System:
    """Puts the scenario's drives and sensors between a slave side and the robot.

    The station has the ports of the slave side. With a drive, control_force is the
    force that the drive delivers, and the further output commanded_force is the force
    that the law commands. With sensors, the outputs measured_position,
    measured_velocity and measured_force are the signals that the law receives, and from
    which it makes the return packet.

    Returns:
        The station, a Diagram; the slave side itself where both are ideal.
    """
    if scenario.actuator.is_ideal and scenario.sensor.is_ideal:
        return slave_side
    n = scenario.num_axes
    slave_side.set_name("law")
    inputs = {name: [name] for name in LAW_INPUTS[2:]}
    systems = {"law": slave_side, **{name: PassThrough(n) for name in inputs}}
    outputs = {name: f"law.{name}" for name in OutputNames(slave_side)}
    # The source of each signal that the law measures: a sensor, if there is one.
    measured = {name: name for name in inputs}
    connections: Connections = {}
    sensors = {
        "encoder": {"tool_position": "sample", "tool_velocity": "rate"},
        "force": {"environment_force": "sample"},
    }
    first = {"encoder": scenario.robot.start.tolist(), "force": [0.0] * n}
    for name, outlets in sensors.items():
        config = getattr(scenario.sensor, name)
        if config.sample_period is None:
            continue
        sensor = f"{name}_sensor"
        systems[sensor] = SampledSensor(
            sample_period=config.sample_period,
            initial_value=first[name],
            resolution=config.resolution,
            noise=config.noise,
            seed=scenario.sensor.seed,
            stream=name,
        )
        connections[sensor] = next(iter(outlets))
        for signal, outlet in outlets.items():
            measured[signal] = f"{sensor}.{outlet}"
    connections |= {f"law.{name}": place for name, place in measured.items()}
    # The drive stands between the law and the robot.
    if not scenario.actuator.is_ideal:
        systems["actuator"] = Actuator(scenario.actuator, num_axes=n)
        connections["actuator.commanded_force"] = "law.control_force"
        connections["actuator.tool_velocity"] = "tool_velocity"
        outputs["commanded_force"] = "law.control_force"
        outputs["control_force"] = "actuator.control_force"
    for name, place in measured.items():
        if place != name:
            outputs[f"measured_{name.rpartition('_')[2]}"] = place
    return Wire(
        Diagram(),
        "controller",
        systems,
        inputs={"forward_packet": ["law.forward_packet"], **inputs},
        connections=connections,
        outputs=outputs,
    )


def ResolveController(scenario: Scenario) -> Any:
    """Returns the config of the scenario's architecture with every default derived.

    Gains are n x n matrices; see ArchitectureConfig.Resolve.

    Raises:
        ScenarioError: If a default cannot be derived.
    """
    controller = scenario.controller
    return controller.Chosen().Resolve(scenario.Facts(), controller.path)


def CheckPorts(
    name: str,
    system: Any,
    *,
    inputs: Mapping[str, int],
    outputs: Mapping[str, int],
    num_axes: int | None = None,
) -> None:
    """Refuses an object that is no system, lacks ports, or has ports of another width.

    Args:
        name: The argument that holds the system, for messages.
        inputs: Width of each input by its name.
        outputs: Width of each output by its name.
        num_axes: Number of task axes, for messages; None: messages do not mention it.

    Raises:
        ScenarioError: The message names all missing ports, or the first port of
            another width.
    """
    CheckIsSystem(name, system)
    missing = [f"input {x}" for x in inputs if not system.HasInputPort(x)]
    missing += [f"output {x}" for x in outputs if not system.HasOutputPort(x)]
    if missing:
        raise ScenarioError(
            f"{name}: {type(system).__name__} lacks the ports {', '.join(missing)}"
        )
    sizes = {x: system.GetOutputPort(x).size() for x in outputs}
    sizes |= {x: system.GetInputPort(x).size() for x in inputs}
    for port, wanted in {**outputs, **inputs}.items():
        size = sizes[port]
        if size != wanted:
            entries = "1 entry" if size == 1 else f"{size} entries"
            reason = f"must have {wanted}"
            if num_axes == wanted:
                axes = "1 axis" if wanted == 1 else f"{wanted} axes"
                reason = f"the task has {axes}"
            raise ScenarioError(f"{name}: {port} has {entries}, {reason}")


def CheckIsSystem(name: str, system: Any) -> None:
    """Refuses an object that is no System of Drake's, such as a class."""
    if isinstance(system, type):
        called = f"{name}={system.__name__}(...)"
        Refuse(name, system, f"an instance: {called}, not {system.__name__}")
    if not isinstance(system, System):
        Refuse(name, system, "a system of Drake's")


def AsChannel(name: str, system: Any, size: int) -> System:
    """Returns a system as a channel, with the ports `signal` and `delayed_signal`.

    Args:
        name: The argument that holds the system, for messages.
        system: Any system with one input and one output, whatever their names.
        size: Width of the packet.

    Raises:
        ScenarioError: If the system has more or fewer ports, or ports of another width.
    """
    CheckIsSystem(name, system)
    if system.num_input_ports() != 1 or system.num_output_ports() != 1:
        Refuse(
            f"{name}: inputs and outputs",
            f"{system.num_input_ports()} and {system.num_output_ports()}",
            "one of each",
        )
    source = system.get_output_port()
    target = system.get_input_port()
    CheckPorts(
        name,
        system,
        inputs={target.get_name(): size},
        outputs={source.get_name(): size},
    )
    if (target.get_name(), source.get_name()) == ("signal", "delayed_signal"):
        return system
    return Wire(
        Diagram(),
        name,
        {"delay": system},
        inputs={"signal": ["delay"]},
        connections={},
        outputs={"delayed_signal": "delay"},
    )
