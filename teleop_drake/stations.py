"""The two ends of the loop: the master station and the slave station (Fig. 2.1).

A control architecture is a pair of them: a master side, which MakeMasterStation puts
between the operator and the channels, and a slave side, which is the station at the
robot. They speak in packets, which is all that the channels between them carry. What a
packet holds is the architecture's own affair; those of the thesis are

    forward packet [F_h; v_d] (2n)      return packet [p_WT; v_WT] (2n)
"""

from collections.abc import Sequence
from typing import Any

from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import Demultiplexer, Multiplexer, PassThrough

from teleop_drake.blocks.architectures import (
    CONTROLLERS,
    Architecture,
    ControlLawConfig,
    Facts,
)
from teleop_drake.blocks.architectures.base import LAW_INPUTS, MakeLawArchitecture
from teleop_drake.blocks.architectures.base import MakeSlaveStation as MakeSlaveStation
from teleop_drake.blocks.architectures.own_law import AsControlLaw, Law
from teleop_drake.blocks.architectures.ports import CheckPorts
from teleop_drake.blocks.environments import CONTACT, FindSurface, Surface
from teleop_drake.blocks.systems.actuator import Actuator
from teleop_drake.blocks.systems.sampled_sensor import SampledSensor
from teleop_drake.scenario import Scenario
from teleop_drake.validation import Refuse


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

    A master side stands between the hand and the channels: it hears what the operator
    applies and commands, and says what the operator feels. With one, the station has
    as further outputs felt_position (n, m), felt_velocity (n, m/s), velocity_command
    (n, m/s), force_command (n, N) and every further output of the master side (its
    telemetry), by its own name.

    Args:
        scenario: Its fields surgeon, haptic_device and environment are used.
        master_side: A system with the inputs haptic_force (n, N: what the operator
            applies), velocity_command (n, m/s) and return_packet (m_r) and the
            outputs felt_position (n, m), felt_velocity (n, m/s) and forward_packet
            (m_f). None: the thesis's packets, [F_h; v_d] sent and [p_WT; v_WT] felt.
        surfaces: Of the environment, of which the operator feels the contact; None:
            those of the scenario's.
        operator: An operator of your own in the place of the scenario's; see
            OperatorConfig.MakeOperator for its ports.
        haptic_device: A device of your own in the place of the scenario's, with the
            inputs velocity_command and felt_velocity and the output haptic_force (n
            each). It may leave out inputs.

    Raises:
        ValueError: If a parameter is not allowed, or a port does not have n entries.
        RuntimeError: If a system lacks one of these ports.
    """
    n = scenario.num_axes
    if surfaces is None:
        surfaces = scenario.Surfaces()
    builder = DiagramBuilder()
    operator = builder.AddNamedSystem(
        "surgeon",
        operator
        or scenario.surgeon.MakeOperator(
            start=scenario.robot.start, contact_surface=FindSurface(surfaces, CONTACT)
        ),
    )
    device = builder.AddNamedSystem(
        "haptic_device",
        haptic_device or scenario.haptic_device.MakeDevice(n),
    )
    force = operator.GetOutputPort("force_command")
    command = operator.GetOutputPort("velocity_command")
    inputs, outputs = _AddMasterSide(builder, master_side, n)
    builder.ExportInput(inputs["return_packet"], "return_packet")
    for source, target, input_name in (
        (outputs["felt_position"], operator, "felt_position"),
        (outputs["felt_velocity"], operator, "felt_velocity"),
        (outputs["felt_velocity"], device, "felt_velocity"),
        (command, device, "velocity_command"),
        (device.GetOutputPort("haptic_force"), operator, "haptic_force"),
    ):
        if target.HasInputPort(input_name):
            builder.Connect(source, target.GetInputPort(input_name))
    builder.Connect(force, inputs["haptic_force"])
    builder.Connect(command, inputs["velocity_command"])
    builder.ExportOutput(outputs.pop("forward_packet"), "forward_packet")
    builder.ExportOutput(operator.GetOutputPort("mode"), "surgeon_mode")
    if master_side is not None:
        builder.ExportOutput(command, "velocity_command")
        builder.ExportOutput(force, "force_command")
        for name, port in outputs.items():
            builder.ExportOutput(port, name)
    master = builder.Build()
    master.set_name("master")
    return master


def _AddMasterSide(
    builder: DiagramBuilder, master_side: System | None, n: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Adds the master side, None for the thesis's, and returns its ports by name."""
    if master_side is None:
        unpack = builder.AddNamedSystem("unpack", Demultiplexer([n, n]))
        pack = builder.AddNamedSystem("pack", Multiplexer([n, n]))
        return {
            "haptic_force": pack.get_input_port(0),
            "velocity_command": pack.get_input_port(1),
            "return_packet": unpack.get_input_port(),
        }, {
            "felt_position": unpack.get_output_port(0),
            "felt_velocity": unpack.get_output_port(1),
            "forward_packet": pack.get_output_port(),
        }
    name = master_side.get_name() or "master_side"
    side = builder.AddNamedSystem(name, master_side)
    needed = ("felt_position", "felt_velocity", "forward_packet")
    outputs = {name: side.GetOutputPort(name) for name in needed}
    ports = map(side.get_output_port, range(side.num_output_ports()))
    return {
        name: side.GetInputPort(name)
        for name in ("haptic_force", "velocity_command", "return_packet")
    }, {port.get_name(): port for port in ports} | outputs


def MakeControlLaw(scenario: Scenario) -> System:
    """Makes the control law that the scenario names, DirectForce for example.

    Raises:
        ScenarioError: If a parameter is not allowed, or the kind is no control law.
    """
    config = scenario.controller.Chosen()
    if not isinstance(config, ControlLawConfig):
        allowed = f"a control law with the thesis's packets, such as {CONTROLLERS[1]}"
        Refuse("controller.kind", config.kind, allowed)
    return config.MakeControlLaw(scenario.Facts(), scenario.controller.path)


def MakeArchitecture(
    scenario: Scenario,
    *,
    control_law: System | Law | None = None,
    facts: Facts | None = None,
) -> Architecture:
    """Makes the architecture that the scenario names.

    Args:
        control_law: A control law of your own, which takes the place of the
            scenario's; it gets the thesis's packets. A system, see MakeSlaveStation,
            or a function, see FunctionLaw.
        facts: What the defaults derive from; None: the scenario's.

    Raises:
        ScenarioError: If a parameter is not allowed, or a default cannot be derived.
        ScenarioError: If the control law lacks a port, or a port has another width.
    """
    facts = facts or scenario.Facts()
    if control_law is not None:
        law = AsControlLaw(control_law, facts.start)
        n = facts.num_axes
        inputs = dict.fromkeys(LAW_INPUTS, n)
        outputs = {"control_force": n}
        CheckPorts("control_law", law, inputs=inputs, outputs=outputs, num_axes=n)
        return MakeLawArchitecture(law, facts.start.tolist())
    chosen = scenario.controller.Chosen()
    return chosen.MakeArchitecture(facts, scenario.controller.path)


def WithDrivesAndSensors(slave_side: System, scenario: Scenario) -> System:
    """Puts the scenario's drives and sensors between a slave side and the robot.

    The station has the ports of the slave side. Its control_force is what the drive
    delivers, and what the law asks for is commanded_force. What is measured is
    measured_position, measured_velocity and measured_force; it is what the law gets,
    and what is returned to the operator.

    Returns:
        The station, a Diagram; the slave side itself where both are ideal.
    """
    if scenario.actuator.is_ideal and scenario.sensor.is_ideal:
        return slave_side
    builder = DiagramBuilder()
    law = builder.AddNamedSystem("law", slave_side)
    builder.ExportInput(law.GetInputPort("forward_packet"), "forward_packet")
    measured = _AddSensors(builder, scenario)
    for name, port in measured.items():
        builder.Connect(port, law.GetInputPort(name))
    ports = map(law.get_output_port, range(law.num_output_ports()))
    outputs = {port.get_name(): port for port in ports}
    if not scenario.actuator.is_ideal:
        n = scenario.num_axes
        drive = builder.AddSystem(Actuator(scenario.actuator, num_axes=n))
        command = outputs["commanded_force"] = outputs["control_force"]
        builder.Connect(command, drive.GetInputPort("commanded_force"))
        outputs["control_force"] = drive.GetOutputPort("control_force")
        velocity = builder.GetSubsystemByName("tool_velocity").get_output_port()
        builder.Connect(velocity, drive.GetInputPort("tool_velocity"))
    for name, port in measured.items():
        if isinstance(port.get_system(), SampledSensor):
            outputs[f"measured_{name.rpartition('_')[2]}"] = port
    for name, port in outputs.items():
        builder.ExportOutput(port, name)
    station = builder.Build()
    station.set_name("controller")
    return station


def _AddSensors(builder: DiagramBuilder, scenario: Scenario) -> dict[str, Any]:
    """Adds inputs and sensors; returns what is measured by the law's names for it."""
    n = scenario.num_axes
    sensor = scenario.sensor
    measured = {}
    for name in ("tool_position", "tool_velocity", "environment_force"):
        signal = builder.AddNamedSystem(name, PassThrough(n))
        builder.ExportInput(signal.get_input_port(), name)
        measured[name] = signal.get_output_port()
    for name, config, target, start in (
        ("encoder", sensor.encoder, "tool_position", scenario.robot.start),
        ("force", sensor.force, "environment_force", [0.0] * n),
    ):
        if config.sample_period is None:
            continue
        block = SampledSensor(
            sample_period=config.sample_period,
            initial_value=list(start),
            resolution=config.resolution,
            noise=config.noise,
            seed=sensor.seed,
            stream=name,
        )
        builder.AddNamedSystem(f"{name}_sensor", block)
        builder.Connect(measured[target], block.get_input_port())
        measured[target] = block.GetOutputPort("sample")
        if name == "encoder":
            measured["tool_velocity"] = block.GetOutputPort("rate")
    return measured


def ResolveController(scenario: Scenario) -> Any:
    """Returns the config of the scenario's architecture with every default derived.

    Gains are n x n matrices; see ArchitectureConfig.Resolve. What cannot be derived is
    refused.
    """
    controller = scenario.controller
    return controller.Chosen().Resolve(scenario.Facts(), controller.path)
