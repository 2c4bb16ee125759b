"""Linear models between any two ports, against closed forms and the loop's own."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, Gain, LinearSystem

from teleop_drake.channels.transport import TransportDelay
from teleop_drake.linear_model.loop import Linearizer
from teleop_drake.linear_model.operating_point import OperatingPoints
from teleop_drake.linear_model.ports import LinearizePorts
from teleop_drake.scenario import LoadScenario
from teleop_drake.teleoperator import MakeTeleoperator

W = np.array([0.1, 1.0, 7.0, 30.0])
T, K = 0.13, 0.7


def MakeLoop():
    """Returns r -> (+) -> 1 / (s + 2) -> y, with -K y(t - T) fed back."""
    builder = DiagramBuilder()
    adder = builder.AddNamedSystem("adder", Adder(2, 1))
    plant = builder.AddNamedSystem("plant", LinearSystem([[-2.0]], [[1.0]], [[1.0]]))
    inner = DiagramBuilder()
    gain = inner.AddNamedSystem("gain", Gain(-K, 1))
    delay = inner.AddNamedSystem("delay", TransportDelay(delay=T, size=1))
    inner.Connect(gain.get_output_port(), delay.get_input_port())
    inner.ExportInput(gain.get_input_port(), "y")
    inner.ExportOutput(delay.get_output_port(), "fed_back")
    feedback = inner.Build()
    feedback.set_name("feedback")
    builder.AddSystem(feedback)
    builder.Connect(adder.get_output_port(), plant.get_input_port())
    builder.Connect(plant.get_output_port(), feedback.get_input_port())
    builder.Connect(feedback.get_output_port(), adder.get_input_port(1))
    builder.ExportInput(adder.get_input_port(0), "r")
    builder.ExportOutput(plant.get_output_port(), "y")
    diagram = builder.Build()
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
    np.testing.assert_allclose(model.Response(W)[:, 0, 0], expected, rtol=1e-12)


def test_a_deviation_inside_runs_around_the_loop_unless_it_is_opened():
    diagram = MakeLoop()
    feedback = diagram.GetSubsystemByName("feedback")
    plant = diagram.GetSubsystemByName("plant")
    context = diagram.CreateDefaultContext()
    closed = LinearizePorts(
        diagram, context, feedback.get_input_port(), plant.get_output_port()
    )
    expected = -LOOP_GAIN / (1 + LOOP_GAIN)
    np.testing.assert_allclose(closed.Response(W)[:, 0, 0], expected, rtol=1e-12)
    # Cut in the middle of the nested diagram: minus the loop gain.
    gain = feedback.GetSubsystemByName("gain")
    opened = LinearizePorts(
        diagram,
        context,
        gain.get_input_port(),
        plant.get_output_port(),
        is_opened=True,
    )
    np.testing.assert_allclose(opened.Response(W)[:, 0, 0], -LOOP_GAIN, rtol=1e-12)


@pytest.mark.parametrize("kind", ["direct_force", "wave_variables"])
def test_half_of_a_teleoperator_is_that_of_the_loop_analysis(kind):
    """From the forward packet received to the return packet sent, in tissue."""
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
    )
    response = model.Response(W)
    assert len(slave.D) == response.shape[1]  # Neither has a delay inside its slave.
    expected = [
        slave.C @ np.linalg.solve(1j * w * np.eye(slave.num_states) - slave.A, slave.B)
        + slave.D
        for w in W
    ]
    np.testing.assert_allclose(response, expected, rtol=1e-5, atol=1e-7)
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
    with pytest.raises(ValueError, match=r"'forward_channel.*must be without samples"):
        LinearizePorts(sampled, sampled.CreateDefaultContext(), *ports)
