"""The two ends of the loop: the master station and the slave station (Fig. 2.1).

A control architecture is a pair of them: a master side, which MakeMasterStation puts
between the surgeon and the channels, and a slave side, which is the station at the
robot. They speak in packets, which is all that the channels between them carry. What a
packet holds is the architecture's own affair; those of the thesis are

    forward packet [F_h; v_d] (2n)      return packet [p_WT; v_WT] (2n)
"""

from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import Demultiplexer, Multiplexer

from teleop_drake.laws.backstepping import BacksteppingGains
from teleop_drake.laws.gaussian_network import GaussianNetwork
from teleop_drake.scenario import CONTROLLERS, GainMatrix, Scenario
from teleop_drake.systems.adaptive_backstepping import AdaptiveBackstepping
from teleop_drake.systems.direct_force import DirectForce
from teleop_drake.systems.haptic_device import HapticDevice
from teleop_drake.systems.surgeon import Surgeon


def MakeMasterStation(scenario: Scenario, master_side: System | None = None) -> Diagram:
    """Makes the surgeon, the haptic device and the master side, named `master`.

    | port | name           | size | unit                             |
    |------|----------------|------|----------------------------------|
    | in   | return_packet  | m_r  | of the packet; thesis [m; m/s]   |
    | out  | forward_packet | m_f  | of the packet; thesis [N; m/s]   |
    | out  | surgeon_mode   | 1    | see Surgeon                      |

    A master side stands between the hand and the channels: it hears what the surgeon
    applies and commands, and says what the surgeon feels. With one, the station has
    as further outputs felt_position (n, m), felt_velocity (n, m/s), velocity_command
    (n, m/s), force_command (n, N) and every further output of the master side (its
    telemetry), by its own name.

    Args:
        scenario: Its fields surgeon, haptic_device and environment are used.
        master_side: A system with the inputs haptic_force (n, N: what the operator
            applies), velocity_command (n, m/s) and return_packet (m_r) and the
            outputs felt_position (n, m), felt_velocity (n, m/s) and forward_packet
            (m_f). None: the thesis's packets, [F_h; v_d] sent and [p_WT; v_WT] felt.

    Raises:
        ValueError: If a parameter is not allowed.
        RuntimeError: If the master side lacks one of these ports.
    """
    n = scenario.num_axes
    builder = DiagramBuilder()
    surgeon = builder.AddNamedSystem(
        "surgeon",
        Surgeon(
            velocity=scenario.surgeon.velocity,
            contact_force=scenario.surgeon.contact_force,
            contact_position=scenario.contact_surface,
            stop_time=scenario.surgeon.stop_time,
        ),
    )
    device = builder.AddNamedSystem(
        "haptic_device",
        HapticDevice(
            numerator=scenario.haptic_device.numerator,
            denominator=scenario.haptic_device.denominator,
            num_axes=n,
        ),
    )
    force = surgeon.GetOutputPort("force_command")
    command = surgeon.GetOutputPort("velocity_command")
    if master_side is None:
        unpack = builder.AddNamedSystem("unpack", Demultiplexer([n, n]))
        pack = builder.AddNamedSystem("pack", Multiplexer([n, n]))
        return_packet = unpack.get_input_port()
        forward_packet = pack.get_output_port()
        felt_position, felt_velocity = map(unpack.get_output_port, (0, 1))
        haptic_force, velocity_command = map(pack.get_input_port, (0, 1))
    else:
        name = master_side.get_name() or "master_side"
        side = builder.AddNamedSystem(name, master_side)
        return_packet = side.GetInputPort("return_packet")
        forward_packet = side.GetOutputPort("forward_packet")
        felt_position, felt_velocity = map(
            side.GetOutputPort, ("felt_position", "felt_velocity")
        )
        haptic_force, velocity_command = map(
            side.GetInputPort, ("haptic_force", "velocity_command")
        )
    builder.ExportInput(return_packet, "return_packet")
    builder.Connect(felt_position, surgeon.GetInputPort("felt_position"))
    builder.Connect(felt_velocity, device.GetInputPort("felt_velocity"))
    builder.Connect(command, device.GetInputPort("velocity_command"))
    builder.Connect(
        device.GetOutputPort("haptic_force"), surgeon.GetInputPort("haptic_force")
    )
    builder.Connect(force, haptic_force)
    builder.Connect(command, velocity_command)
    builder.ExportOutput(forward_packet, "forward_packet")
    builder.ExportOutput(surgeon.GetOutputPort("mode"), "surgeon_mode")
    if master_side is not None:
        builder.ExportOutput(command, "velocity_command")
        builder.ExportOutput(force, "force_command")
        for i in range(master_side.num_output_ports()):
            port = master_side.get_output_port(i)
            if port.get_name() != "forward_packet":
                builder.ExportOutput(port, port.get_name())
    master = builder.Build()
    master.set_name("master")
    return master


def MakeControlLaw(scenario: Scenario) -> System:
    """Makes the thesis's control law that the scenario names, DirectForce for example.

    Args:
        scenario: Its field controller is used; `auto` also needs robot and
            environment.

    Raises:
        ValueError: If a parameter is not allowed, or the kind has no such law.
    """
    config, n = scenario.controller, scenario.num_axes
    if config.kind == "direct_force":
        return DirectForce(num_axes=n)
    if config.kind != "adaptive_backstepping":
        raise ValueError(
            f"controller.kind: {config.kind}; allowed: {', '.join(CONTROLLERS)}"
        )
    beta, nu = config.adaptation_rate, config.leakage
    return AdaptiveBackstepping(
        gains=BacksteppingGains(
            Lambda=GainMatrix(config.Lambda, n),
            G1=GainMatrix(config.G1, n),
            G2=GainMatrix(config.G2, n),
            P=GainMatrix(config.P, n),
            beta1=beta,
            beta2=beta,
            beta3=beta,
            nu1=nu,
            nu3=nu,
            Upsilon=config.supervision,
            Psi0=scenario.initial_psi,
            Psi_min=config.minimum_psi,
        ),
        network=GaussianNetwork(
            lower=config.network.lower,
            upper=config.network.upper,
            count=config.network.count,
            width=config.network.width,
        ),
    )


def MakeSlaveStation(control_law: System) -> Diagram:
    """Makes the slave side of the thesis out of a control law, named `controller`.

    | port | name              | size | unit     |
    |------|-------------------|------|----------|
    | in   | forward_packet    | 2n   | [N; m/s] |
    | in   | tool_position     | n    | m        |
    | in   | tool_velocity     | n    | m/s      |
    | in   | environment_force | n    | N        |
    | out  | control_force     | n    | N        |
    | out  | return_packet     | 2n   | [m; m/s] |

    and every further output of the control law (its telemetry), by its own name.

    Args:
        control_law: A system with the inputs haptic_force, velocity_command,
            tool_position, tool_velocity and environment_force and the output
            control_force (n each), such as DirectForce.

    Raises:
        RuntimeError: If the control law lacks one of these ports.
    """
    n = control_law.GetOutputPort("control_force").size()
    builder = DiagramBuilder()
    unpack = builder.AddNamedSystem("unpack", Demultiplexer([n, n]))
    law = builder.AddNamedSystem(control_law.get_name() or "control_law", control_law)
    pack = builder.AddNamedSystem("pack", Multiplexer([n, n]))
    builder.ExportInput(unpack.get_input_port(), "forward_packet")
    builder.Connect(unpack.get_output_port(0), law.GetInputPort("haptic_force"))
    builder.Connect(unpack.get_output_port(1), law.GetInputPort("velocity_command"))
    for i, name in enumerate(("tool_position", "tool_velocity")):
        port = builder.ExportInput(law.GetInputPort(name), name)
        builder.ConnectInput(port, pack.get_input_port(i))
    builder.ExportInput(law.GetInputPort("environment_force"), "environment_force")
    builder.ExportOutput(law.GetOutputPort("control_force"), "control_force")
    builder.ExportOutput(pack.get_output_port(), "return_packet")
    for i in range(law.num_output_ports()):
        port = law.get_output_port(i)
        if port.get_name() != "control_force":
            builder.ExportOutput(port, port.get_name())
    controller = builder.Build()
    controller.set_name("controller")
    return controller
