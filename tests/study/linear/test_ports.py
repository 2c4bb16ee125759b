"""Linear models between any two ports, against closed forms and the loop analysis."""

import numpy as np
import pytest
from drake_systems import FinishArm, TheMeshcat
from numpy.testing import assert_allclose
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ExternallyAppliedSpatialForce,
)
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Adder,
    ConstantValueSource,
    Gain,
    LinearSystem,
    VectorLogSink,
    ZeroOrderHold,
)
from pydrake.visualization import AddDefaultVisualization
from wired import Wired

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.linear.ports import LinearizePorts
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoints

W = np.array([0.1, 1.0, 7.0, 30.0])
T = 0.13
K = 0.7


def MakeLoop():
    """Returns the loop r -> (+) -> 1 / (s + 2) -> y with the feedback -K y(t - T)."""
    feedback = Wired(
        {"gain": Gain(-K, 1), "delay": TransportDelay(delay=T, size=1)},
        {"delay": "gain"},
        {"fed_back": "delay"},
        inputs={"y": "gain"},
    )
    feedback.set_name("feedback")
    diagram = Wired(
        {
            "adder": Adder(2, 1),
            "plant": LinearSystem([[-2.0]], [[1.0]], [[1.0]]),
            "feedback": feedback,
        },
        {"plant": "adder", "feedback": "plant", "adder.u1": "feedback"},
        {"y": "plant"},
        inputs={"r": "adder.u0"},
    )
    diagram.set_name("loop")
    return diagram


def Plant():
    return 1 / (1j * W + 2)


LOOP_GAIN = K * np.exp(-1j * W * T) / (1j * W + 2)


def test_closed_loop_from_the_diagrams_own_ports():
    diagram = MakeLoop()
    model = LinearizePorts(
        diagram,
        diagram.CreateDefaultContext(),
        diagram.get_input_port(),
        diagram.get_output_port(),
    )
    assert model.delays == (T,)
    assert repr(model).startswith(
        "PortModel(1 -> 1, 1 states, delays [0.13] s, 0 held)"
    )
    assert model.by_differences == () and model.held == ()
    expected = Plant() / (1 + LOOP_GAIN)
    assert_allclose(model.Response(W)[:, 0, 0], expected, rtol=1e-12)


def test_a_deviation_inside_runs_around_the_loop_unless_it_is_opened():
    diagram = MakeLoop()
    feedback = diagram.GetSubsystemByName("feedback")
    plant = diagram.GetSubsystemByName("plant")
    context = diagram.CreateDefaultContext()
    closed = LinearizePorts(
        diagram, context, feedback.get_input_port(), plant.get_output_port()
    )
    expected = -LOOP_GAIN / (1 + LOOP_GAIN)
    assert_allclose(closed.Response(W)[:, 0, 0], expected, rtol=1e-12)
    # Opened within the nested diagram, the response is minus the loop gain.
    gain = feedback.GetSubsystemByName("gain")
    opened = LinearizePorts(
        diagram,
        context,
        gain.get_input_port(),
        plant.get_output_port(),
        is_opened=True,
    )
    assert_allclose(opened.Response(W)[:, 0, 0], -LOOP_GAIN, rtol=1e-12)


@pytest.mark.parametrize("kind", ["direct_force", "wave_variables"])
def test_half_of_a_teleoperator_is_that_of_the_loop_analysis(kind):
    """The model is from the received forward packet to the sent return packet."""
    scenario = LoadScenario("one_dof", {"controller.kind": kind})
    (point,) = (x for x in OperatingPoints(scenario) if x.name == "tissue")
    slave = Linearizer(scenario).Loop(point).slave
    teleoperator = MakeTeleoperator(scenario)
    context = teleoperator.CreateDefaultContext()
    plant = teleoperator.GetSubsystemByName("robot")
    state = plant.GetMyMutableContextFromRoot(context)
    state.SetContinuousState([*point.position, *point.velocity])
    controller = teleoperator.GetSubsystemByName("controller")
    model = LinearizePorts(
        teleoperator,
        context,
        controller.GetInputPort("forward_packet"),
        controller.GetOutputPort("return_packet"),
        is_opened=True,
        is_moving=True,
    )
    response = model.Response(W)
    assert len(slave.D) == response.shape[1]  # The slaves have no inner delay.
    expected = [
        slave.C @ np.linalg.solve(1j * w * np.eye(slave.num_states) - slave.A, slave.B)
        + slave.D
        for w in W
    ]
    assert_allclose(response, expected, rtol=1e-5, atol=1e-7)
    assert any("environment" in name for name in model.held)


def test_what_has_no_linear_model_is_refused():
    diagram = MakeLoop()
    context = diagram.CreateDefaultContext()
    other = Gain(1.0, 1)
    with pytest.raises(ValueError, match="must be one in the diagram"):
        LinearizePorts(
            diagram, context, other.get_input_port(), diagram.get_output_port()
        )
    sampled = MakeTeleoperator(
        LoadScenario(
            "one_dof", ["forward_channel={kind: sampled, sample_period: 0.01}"]
        )
    )
    controller = sampled.GetSubsystemByName("controller")
    ports = controller.get_input_port(0), controller.get_output_port(0)
    with pytest.raises(ValueError, match=r"because forward_channel takes samples"):
        LinearizePorts(sampled, sampled.CreateDefaultContext(), *ports)


def test_a_context_with_an_accuracy_holds_the_layer_that_it_has():
    """The tool is in the tissue, while the environment's mode is still free space."""
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    teleoperator = MakeTeleoperator(scenario)
    context = teleoperator.CreateDefaultContext()
    robot = teleoperator.GetSubsystemByName("robot")
    environment = teleoperator.GetSubsystemByName("environment")
    layer = environment.GetMyMutableContextFromRoot(context)

    def Damping(position):
        robot.GetMyMutableContextFromRoot(context).SetContinuousState([position, 0.001])
        model = LinearizePorts(
            teleoperator,
            context,
            environment.GetInputPort("tool_velocity"),
            environment.GetOutputPort("environment_force"),
            is_opened=True,
            is_moving=True,
        )
        return model.D[0, 0]

    assert Damping(0.003) == pytest.approx(0.5, rel=1e-9)
    assert Damping(0.01) == 0.0
    layer.SetDiscreteState(LayerAt(0.01, teleoperator))
    context.SetAccuracy(1e-6)
    assert Damping(0.003) == 0.0


def LayerAt(position, teleoperator):
    """Returns the environment's mode at the start of a run at a position."""
    context = teleoperator.CreateDefaultContext()
    robot = teleoperator.GetSubsystemByName("robot")
    robot.GetMyMutableContextFromRoot(context).SetContinuousState([position, 0.001])
    teleoperator.ExecuteInitializationEvents(context)
    environment = teleoperator.GetSubsystemByName("environment")
    layer = environment.GetMyContextFromRoot(context)
    return layer.get_discrete_state_vector().CopyToVector()


def test_what_a_delay_delivers_may_be_the_output_and_may_enter_a_delay():
    """Two delays in series, from the diagram's input to its output."""
    diagram = Wired(
        {
            "first": TransportDelay(delay=0.1, size=1),
            "second": TransportDelay(delay=T, size=1),
        },
        {"second": "first"},
        {"y": "second"},
        inputs={"u": "first"},
    )
    model = LinearizePorts(
        diagram,
        diagram.CreateDefaultContext(),
        diagram.get_input_port(),
        diagram.get_output_port(),
    )
    expected = np.exp(-1j * W * (0.1 + T))
    assert_allclose(model.Response(W)[:, 0, 0], expected, rtol=1e-12)
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, [2.5])
    with pytest.raises(ValueError, match=r"'first' with an output .* by 2\.5 "):
        LinearizePorts(
            diagram, context, diagram.get_input_port(), diagram.get_output_port()
        )


@pytest.mark.parametrize("is_opened", [True, False])
def test_a_deviation_added_to_what_a_delay_delivers(is_opened):
    diagram = MakeLoop()
    adder = diagram.GetSubsystemByName("adder")
    plant = diagram.GetSubsystemByName("plant")
    model = LinearizePorts(
        diagram,
        diagram.CreateDefaultContext(),
        adder.get_input_port(1),
        plant.get_output_port(),
        is_opened=is_opened,
    )
    expected = Plant() if is_opened else Plant() / (1 + LOOP_GAIN)
    assert_allclose(model.Response(W)[:, 0, 0], expected, rtol=1e-12)


class Cubic(LeafSystem):
    """y = u^3 - x, dx/dt = -x^3 + u, which does not convert to AutoDiffXd."""

    def __init__(self):
        LeafSystem.__init__(self)
        u = self.DeclareVectorInputPort("u", 1)
        self.DeclareContinuousState(BasicVector([0.5]))
        self._u = u

        def Calc(context, output):
            x = context.get_continuous_state_vector().CopyToVector()
            output.SetFromVector(u.Eval(context) ** 3 - x)

        self.DeclareVectorOutputPort("y", 1, Calc)

    def DoCalcTimeDerivatives(self, context, derivatives):
        x = context.get_continuous_state_vector().CopyToVector()
        derivatives.SetFromVector(-(x**3) + self._u.Eval(context))


def test_a_diagram_that_does_not_convert_is_linearised_by_differences():
    """u -> delay -> Cubic -> y, at x = 0.5 and u = 0.25, which is no equilibrium."""
    delay = TransportDelay(delay=T, size=1, initial_value=[0.25])
    diagram = Wired(
        {"delay": delay, "cubic": Cubic()},
        {"cubic": "delay"},
        {"y": "cubic"},
        inputs={"u": "delay"},
    )
    model = LinearizePorts(
        diagram,
        diagram.CreateDefaultContext(),
        diagram.get_input_port(),
        diagram.get_output_port(),
        is_moving=True,
    )
    assert model.by_differences == ("cubic",)
    expected = (3 * 0.25**2 - 1 / (1j * W + 3 * 0.5**2)) * np.exp(-1j * W * T)
    assert_allclose(model.Response(W)[:, 0, 0], expected, rtol=1e-9)


def _MakeArm(add):
    """Returns a diagram with a hinged ball of 0.004 kg m^2, and the ball's plant.

    Args:
        add: A function that adds further systems to the builder and the plant.
    """
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    FinishArm(plant)
    add(builder, plant)
    return builder.Build(), plant


def _CheckArm(diagram, plant, by_differences):
    """Checks the response from torque to angle, 1 / (I s^2)."""
    model = LinearizePorts(
        diagram,
        diagram.CreateDefaultContext(),
        plant.get_actuation_input_port(),
        plant.get_state_output_port(),
    )
    expected = -1 / (0.004 * W**2)
    rtol = 1e-8 if by_differences else 1e-12
    assert_allclose(model.Response(W)[:, 0, 0], expected, rtol=rtol)
    assert model.by_differences == by_differences


def test_the_default_visualization_is_left_out():
    diagram, plant = _MakeArm(
        lambda builder, _: AddDefaultVisualization(builder, TheMeshcat())
    )
    _CheckArm(diagram, plant, ())


def test_a_block_that_does_not_convert_is_left_out_where_nothing_depends_on_it():
    """A sampled law of Python whose result only a log receives."""

    def Add(builder, plant):
        law = builder.AddNamedSystem("law", Cubic())
        hold = builder.AddNamedSystem("hold", ZeroOrderHold(0.1, 1))
        log = builder.AddNamedSystem("log", VectorLogSink(1))
        builder.Connect(plant.get_net_actuation_output_port(), law.get_input_port())
        builder.Connect(law.get_output_port(), hold.get_input_port())
        builder.Connect(hold.get_output_port(), log.get_input_port())

    diagram, plant = _MakeArm(Add)
    law = diagram.GetSubsystemByName("law")
    with pytest.raises(ValueError, match="because hold takes samples"):
        LinearizePorts(
            diagram,
            diagram.CreateDefaultContext(),
            plant.get_actuation_input_port(),
            diagram.GetSubsystemByName("hold").get_output_port(),
        )
    assert law.num_continuous_states() == 1
    model = LinearizePorts(
        diagram,
        diagram.CreateDefaultContext(),
        plant.get_actuation_input_port(),
        plant.get_state_output_port(),
        is_moving=True,
    )
    # Its state is a state of the model.
    assert model.by_differences == ("law",)
    assert model.held == ()


@pytest.mark.parametrize("is_fixed", [True, False])
def test_a_constant_force_that_drake_does_not_convert_is_named(is_fixed):
    """Left out of the converted diagram, the spring at the ball would have no force."""
    force = ExternallyAppliedSpatialForce()
    force.F_Bq_W = SpatialForce(tau=[0.0, 0.3, 0.0], f=[0.0, 0.0, 0.0])

    def Add(builder, plant):
        force.body_index = plant.GetBodyByName("link0").index()
        port = plant.get_applied_spatial_force_input_port()
        if is_fixed:
            builder.ExportInput(port, "forces")
            return
        source = ConstantValueSource(
            Value[list[ExternallyAppliedSpatialForce]]([force])
        )
        builder.AddNamedSystem("force", source)
        builder.Connect(source.get_output_port(), port)

    diagram, plant = _MakeArm(Add)
    context = diagram.CreateDefaultContext()
    if is_fixed:
        diagram.get_input_port().FixValue(context, [force])
    model = LinearizePorts(
        diagram,
        context,
        plant.get_actuation_input_port(),
        plant.get_generalized_acceleration_output_port(),
        is_moving=True,
    )
    assert model.by_differences == ("plant" if is_fixed else "force",)
    assert_allclose(model.D, [[1 / 0.004]], rtol=1e-8)
