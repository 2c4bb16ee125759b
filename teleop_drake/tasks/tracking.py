"""The demonstration of chapter 3 as one Diagram: an arm learns a disturbance."""

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource, Sine

from teleop_drake.laws.gaussian_network import GaussianNetwork
from teleop_drake.laws.tracking import TrackingGains
from teleop_drake.robots import PlantRobotConfig
from teleop_drake.scenario import GainMatrix, TrackingScenario, TrajectoryConfig
from teleop_drake.signals import NamedSignals
from teleop_drake.systems.disturbance_force import DisturbanceForce
from teleop_drake.systems.network_tracking_controller import NetworkTrackingController


def MakeReference(config: TrajectoryConfig) -> Diagram:
    """Makes r_d(t) = centre + amplitude sin(frequency t + phase), named `reference`.

    | port | name                 | size | unit  |
    |------|----------------------|------|-------|
    | out  | desired_position     | n    | m     |
    | out  | desired_velocity     | n    | m/s   |
    | out  | desired_acceleration | n    | m/s^2 |

    Args:
        config: The trajectory (3.28).
    """
    n = len(config.centre)
    builder = DiagramBuilder()
    centre = builder.AddNamedSystem("centre", ConstantVectorSource(config.centre))
    sine = builder.AddNamedSystem(
        "sine", Sine(config.amplitude, [config.frequency] * n, [config.phase] * n, True)
    )
    position = builder.AddNamedSystem("position", Adder(2, n))
    builder.Connect(centre.get_output_port(), position.get_input_port(0))
    builder.Connect(sine.get_output_port(0), position.get_input_port(1))
    builder.ExportOutput(position.get_output_port(), "desired_position")
    builder.ExportOutput(sine.get_output_port(1), "desired_velocity")
    builder.ExportOutput(sine.get_output_port(2), "desired_acceleration")
    reference = builder.Build()
    reference.set_name("reference")
    return reference


def MakeNetworkTracking(scenario: TrackingScenario) -> Diagram:
    """Makes the demonstration of chapter 3, four systems.

        reference -> controller -> robot <-> disturbance
                         ^           |
                         +-----------+

    The controller does not feel the disturbance: it learns it from the motion.

    Args:
        scenario: What to build.

    Returns:
        The Diagram, named `network_tracking`. Its default context is the start.

    Raises:
        ScenarioError: If the scenario is not valid.
    """
    scenario.Validate()
    n, config, law = scenario.num_axes, scenario.robot, scenario.controller
    assert isinstance(config, PlantRobotConfig)  # Validated.
    builder = DiagramBuilder()
    reference = builder.AddNamedSystem("reference", MakeReference(scenario.trajectory))
    controller = builder.AddNamedSystem(
        "controller",
        NetworkTrackingController(
            gains=TrackingGains(
                Lambda=GainMatrix(law.Lambda, n),
                G1=GainMatrix(law.G1, n),
                beta=law.adaptation_rate,
                nu=law.leakage,
            ),
            network=GaussianNetwork(
                lower=law.network.lower,
                upper=law.network.upper,
                count=law.network.count,
                width=law.network.width,
            ),
            plant=config.LoadPlant(scenario.gravity),
        ),
    )
    robot = builder.AddNamedSystem(
        "robot",
        config.MakeRobot(gravity=scenario.gravity),
    )
    disturbance = builder.AddNamedSystem(
        "disturbance",
        DisturbanceForce(
            kind=scenario.disturbance.kind,
            gain=GainMatrix(scenario.disturbance.gain, n),
        ),
    )
    # Refuses names that stand for another signal of the loop.
    NamedSignals((reference, controller, robot, disturbance))
    for source, target, names in (
        (
            reference,
            controller,
            ("desired_position", "desired_velocity", "desired_acceleration"),
        ),
        (
            robot,
            controller,
            ("tool_position", "tool_velocity", "joint_position", "joint_velocity"),
        ),
        (controller, robot, ("control_force",)),
        (robot, disturbance, ("tool_position", "tool_velocity")),
        (disturbance, robot, ("environment_force",)),
    ):
        for name in names:
            builder.Connect(source.GetOutputPort(name), target.GetInputPort(name))
    diagram = builder.Build()
    diagram.set_name("network_tracking")
    return diagram
