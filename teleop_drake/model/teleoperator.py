"""The whole loop as one Diagram: Fig. 2.1 of the thesis."""

from collections.abc import Mapping, Sequence

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.framework.arrays import Names
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.model.blocks.architectures import Architecture
from teleop_drake.model.blocks.architectures.own_law import Law
from teleop_drake.model.blocks.environments import SurfacesOf
from teleop_drake.model.channels.fields import WithFieldDelays
from teleop_drake.model.scenario import (
    AsTeleoperation,
    CheckStart,
    Scenario,
    ScenarioLike,
)
from teleop_drake.model.signals import NamedSignals
from teleop_drake.model.stations import (
    AsChannel,
    CheckPorts,
    MakeArchitecture,
    MakeMasterStation,
    WithDrivesAndSensors,
)


def MakeTeleoperator(
    scenario: ScenarioLike,
    *,
    side: str | None = None,
    control_law: System | Law | None = None,
    architecture: Architecture | None = None,
    robot: System | None = None,
    environment: System | None = None,
    forward_channel: System | None = None,
    return_channel: System | None = None,
    operator: System | None = None,
    haptic_device: System | None = None,
) -> Diagram:
    """Makes the teleoperator, six systems with the names of Fig. 2.1.

        master -> forward_channel -> controller -> robot <-> environment
          ^                              |
          +------- return_channel <------+

    Before the first packet arrives, the channels deliver the architecture's initial
    packets. In the thesis's architectures these are zero force and zero velocity
    command (forward), and the start position at rest (return).

    The systems that are given replace those of the scenario.

    Args:
        scenario: The scenario, or its name or file.
        side: One of SIDES, to make only the systems of this side; None: both sides.
        control_law: A control law: a system with the ports of
            stations.MakeSlaveStation, or a plain function as FunctionLaw takes it.
        architecture: An architecture, which is both sides; not together with
            control_law.
        robot: A robot; see robots.MakeRobotDiagram for its ports, of which
            control_force, environment_force, tool_position and tool_velocity are
            required.
        environment: An environment; inputs tool_position and tool_velocity, output
            environment_force (n each); see EnvironmentConfig.MakeEnvironment for its
            optional method Surfaces().
        forward_channel: A channel: any system with one input and one output, both as
            wide as the forward packet.
        return_channel: A channel as wide as the return packet.
        operator: An operator; see OperatorConfig.MakeOperator for its ports and its
            optional attributes. Limits of a run, operating points of an analysis and
            defaults of the controller still derive from the scenario's
            surgeon.velocity.
        haptic_device: A haptic device; inputs velocity_command and felt_velocity,
            output haptic_force (n each).

    Returns:
        The Diagram, named `teleoperator`. Its default Context is the start of a run.

    Raises:
        ScenarioError: If the scenario is not valid.
        ValueError: If both a control law and an architecture are given, or a packet
            does not have the width of its initial value, or an output of a given system
            has the name of another signal of the loop.
        ScenarioError: If a given system lacks a port, or a port has another width.
    """
    builder = DiagramBuilder()
    AddTeleoperator(
        builder,
        scenario,
        side=side,
        control_law=control_law,
        architecture=architecture,
        robot=robot,
        environment=environment,
        forward_channel=forward_channel,
        return_channel=return_channel,
        operator=operator,
        haptic_device=haptic_device,
    )
    teleoperator = builder.Build()
    teleoperator.set_name("teleoperator")
    return teleoperator


SIDES = {
    "operator": ("master", "return_channel"),
    "robot": ("forward_channel", "controller", "robot", "environment"),
}
"""The systems of each side, including the channel through which it gets packets."""


def AddTeleoperator(
    builder: DiagramBuilder,
    scenario: ScenarioLike,
    *,
    side: str | None = None,
    control_law: System | Law | None = None,
    architecture: Architecture | None = None,
    robot: System | None = None,
    environment: System | None = None,
    forward_channel: System | None = None,
    return_channel: System | None = None,
    operator: System | None = None,
    haptic_device: System | None = None,
) -> Architecture:
    """Adds the teleoperator's six systems and connects them; returns its architecture.

    The arguments are those of MakeTeleoperator(). With `side`, the channel has no delay
    and its input is not connected. A further system, such as a meter of energy (see
    analysis.energy), finds one of the six with `builder.GetSubsystemByName("master")`.
    """
    scenario = AsTeleoperation(scenario)
    scenario.Validate()
    # Robot and environment first: defaults of the architecture derive from them.
    start = scenario.robot.start
    robot = robot or scenario.robot.MakeRobot()
    environment = environment or scenario.environment.MakeEnvironment(start)
    _CheckOwn(robot, environment, operator, haptic_device, scenario.num_axes)
    surfaces = SurfacesOf(environment) or ()
    CheckStart(start, surfaces)
    if architecture is None:
        facts = scenario.Facts(robot, environment)
        architecture = MakeArchitecture(scenario, control_law=control_law, facts=facts)
    elif control_law is not None:
        Refuse("control_law", control_law, "left out with an architecture")
    master = MakeMasterStation(
        scenario,
        architecture.master_side,
        surfaces=surfaces,
        operator=operator,
        haptic_device=haptic_device,
    )
    controller = WithDrivesAndSensors(architecture.slave_side, scenario)
    systems = {
        "master": master,
        "forward_channel": _MakeChannel(
            "forward_channel",
            forward_channel,
            scenario,
            side,
            master.GetOutputPort("forward_packet").size(),
            architecture,
        ),
        "controller": controller,
        "robot": robot,
        "environment": environment,
        "return_channel": _MakeChannel(
            "return_channel",
            return_channel,
            scenario,
            side,
            controller.GetOutputPort("return_packet").size(),
            architecture,
        ),
    }
    _AddLoop(builder, systems, side)
    return architecture


def _CheckOwn(
    robot: System,
    environment: System,
    operator: System | None,
    haptic_device: System | None,
    num_axes: int,
) -> None:
    """Refuses a system that lacks a port of Fig. 2.1, or has one of another width."""
    n = num_axes
    motion = {"tool_position": n, "tool_velocity": n}
    force = {"environment_force": n}
    commands = {"velocity_command": n, "force_command": n, "mode": 1}
    wanted = {
        "robot": (robot, {"control_force": n, **force}, motion),
        "environment": (environment, motion, force),
        "operator": (operator, {}, commands),
        "haptic_device": (haptic_device, {}, {"haptic_force": n}),
    }
    for name, (system, inputs, outputs) in wanted.items():
        if system is not None:
            CheckPorts(name, system, inputs=inputs, outputs=outputs, num_axes=n)


def _MakeChannel(
    name: str,
    channel: System | None,
    scenario: Scenario,
    side: str | None,
    size: int,
    architecture: Architecture,
) -> System:
    """Returns a channel: the user's, the scenario's or, for one side, no delay."""
    initial_value, fields = _PacketOf(architecture, name)
    if side is not None:
        if channel is not None:
            Refuse(name, channel.get_name(), "left out: a side hears packets")
        return TransportDelay(delay=0.0, size=size, initial_value=initial_value)
    if channel is None:
        config = getattr(scenario, name)
        made = config.MakeChannel(
            size=size,
            initial_value=initial_value,
            duration=scenario.duration,
            stream=name,
        )
        channel = WithFieldDelays(made, config.fields, fields, initial_value, name)
    return AsChannel(name, channel, size)


def _PacketOf(
    architecture: Architecture, channel: str
) -> tuple[Sequence[float], Names]:
    """Returns the initial packet of a channel, and the names of its fields."""
    if channel == "forward_channel":
        return architecture.initial_forward_packet, architecture.forward_fields
    return architecture.initial_return_packet, architecture.return_fields


_CONNECTIONS = (
    ("master", "forward_packet", "forward_channel", "signal"),
    ("forward_channel", "delayed_signal", "controller", "forward_packet"),
    ("controller", "control_force", "robot", "control_force"),
    ("robot", "tool_position", "environment", "tool_position"),
    ("robot", "tool_velocity", "environment", "tool_velocity"),
    ("environment", "environment_force", "robot", "environment_force"),
    ("robot", "tool_position", "controller", "tool_position"),
    ("robot", "tool_velocity", "controller", "tool_velocity"),
    ("environment", "environment_force", "controller", "environment_force"),
    ("controller", "return_packet", "return_channel", "signal"),
    ("return_channel", "delayed_signal", "master", "return_packet"),
)
"""The connections of Fig. 2.1: a system, its output, the next system, its input."""


def _AddLoop(
    builder: DiagramBuilder, systems: Mapping[str, System], side: str | None
) -> None:
    """Adds the systems of the loop or of a side, and the connections between them."""
    present = systems if side is None else {x: systems[x] for x in SIDES[side]}
    for name, system in present.items():
        builder.AddNamedSystem(name, system)
    NamedSignals(present.values())  # Refuses two signals of one name.
    for source, output, target, input_name in _CONNECTIONS:
        if source in present and target in present:
            builder.Connect(
                present[source].GetOutputPort(output),
                present[target].GetInputPort(input_name),
            )
