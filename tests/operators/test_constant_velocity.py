"""Tests of the operator of the thesis."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Integrator,
    LogVectorOutput,
)

from teleop_drake.channels.sampled import SampledDelay
from teleop_drake.environments import Surface
from teleop_drake.operators import ConstantVelocityOperator


class Bench:
    """An operator who feels p = [t, 0] and a haptic device that reads [1, 2]."""

    def __init__(self, *, channel=None, accuracy=None, **arguments):
        parameters = {
            "velocity": [0.1, 0.0],
            "contact_force": [0.2, 0.0],
            "contact_surface": Surface("contact", [0.55, 0.0], [1.0, 0.0]),
        } | arguments
        builder = DiagramBuilder()
        self.dut = builder.AddNamedSystem("dut", ConstantVelocityOperator(**parameters))
        force = builder.AddNamedSystem("force", ConstantVectorSource([1.0, 2.0]))
        speed = builder.AddNamedSystem("speed", ConstantVectorSource([1.0, 0.0]))
        position = builder.AddNamedSystem("position", Integrator(2))
        builder.Connect(speed.get_output_port(), position.get_input_port())
        felt = position.get_output_port()
        if channel is not None:
            builder.AddNamedSystem("channel", channel)
            builder.Connect(felt, channel.get_input_port())
            felt = channel.get_output_port()
        builder.Connect(felt, self.dut.GetInputPort("felt_position"))
        builder.Connect(force.get_output_port(), self.dut.GetInputPort("haptic_force"))
        # What is commanded, integrated: tells when it changed.
        impulse = builder.AddNamedSystem("impulse", Integrator(2))
        builder.Connect(
            self.dut.GetOutputPort("force_command"), impulse.get_input_port()
        )
        self.logger = LogVectorOutput(impulse.get_output_port(), builder)
        self.simulator = Simulator(builder.Build())
        if accuracy is not None:
            self.simulator.get_mutable_context().SetAccuracy(accuracy)

    def At(self, time):
        """Returns (mode, v_d, F_h) after the events at a time."""
        self.simulator.AdvanceTo(time)
        self.simulator.AdvancePendingEvents()
        context = self.dut.GetMyContextFromRoot(self.simulator.get_context())
        mode, velocity, force = (
            self.dut.GetOutputPort(name).Eval(context).tolist()
            for name in ("mode", "velocity_command", "force_command")
        )
        return mode[0], velocity, force

    def SwitchTime(self, end):
        """Returns when the first force command went from 1 N to 0.2 N."""
        self.At(end)
        log = self.logger.FindLog(self.simulator.get_context())
        return (log.data()[0, -1] - 0.2 * end) / (1.0 - 0.2)


@pytest.mark.parametrize("accuracy", [1e-6, None])
def test_velocity_then_force(accuracy):
    bench = Bench(accuracy=accuracy)
    assert bench.At(0.5) == (0, [0.1, 0.0], [1.0, 2.0])
    assert bench.At(0.7) == (1, [0.0, 0.0], [0.2, 0.0])
    assert bench.At(2.0) == (1, [0.0, 0.0], [0.2, 0.0])


def test_contact_is_located():
    assert Bench(accuracy=1e-6).SwitchTime(1.0) == pytest.approx(0.55, abs=1e-6)


@pytest.mark.parametrize("accuracy", [1e-6, None])
def test_contact_behind_a_sampled_channel(accuracy):
    """The packet sent at 0.6 is the first beyond 0.55, and arrives at 0.8."""
    channel = SampledDelay(delay=0.2, sample_period=0.1, size=2)
    bench = Bench(channel=channel, accuracy=accuracy)
    assert bench.SwitchTime(1.5) == pytest.approx(0.8, abs=1e-9)


def test_contact_is_latched():
    """It stays in force mode although the tool is felt in front of the bone again."""
    dut = ConstantVelocityOperator(
        velocity=[0.1],
        contact_force=[0.2],
        contact_surface=Surface("contact", [0.5], [1.0]),
    )
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    dut.GetInputPort("haptic_force").FixValue(context, [1.0])
    position = dut.GetInputPort("felt_position").FixValue(context, [0.6])
    simulator.AdvanceTo(0.1)
    position.GetMutableData().set_value([0.0])
    simulator.AdvanceTo(0.2)
    assert dut.GetOutputPort("mode").Eval(context)[0] == 1


def test_stop_after_contact_withdraws_the_force():
    bench = Bench(accuracy=1e-6, stop_time=1.25)
    assert bench.At(1.2) == (1, [0.0, 0.0], [0.2, 0.0])
    assert bench.At(1.25) == (2, [0.0, 0.0], [0.0, 0.0])


def test_stop_before_contact_leaves_the_haptic_device_braking():
    bench = Bench(accuracy=1e-6, stop_time=0.25)
    assert bench.At(0.2) == (0, [0.1, 0.0], [1.0, 2.0])
    assert bench.At(0.3) == (2, [0.0, 0.0], [1.0, 2.0])
    assert bench.At(0.9) == (2, [0.0, 0.0], [1.0, 2.0])


@pytest.mark.parametrize(
    "arguments", [{"contact_force": None}, {"contact_surface": None}]
)
def test_never_switches_without_force_or_surface(arguments):
    assert Bench(accuracy=1e-6, **arguments).At(3.0) == (0, [0.1, 0.0], [1.0, 2.0])


def test_feedthrough():
    dut = ConstantVelocityOperator(velocity=[0.1])
    for output in ("velocity_command", "force_command", "mode"):
        for source in ("haptic_force", "felt_position"):
            assert dut.HasDirectFeedthrough(
                dut.GetInputPort(source).get_index(),
                dut.GetOutputPort(output).get_index(),
            ) == (output == "force_command" and source == "haptic_force")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"velocity": [math.nan]}, "velocity = "),
        ({"contact_force": [1.0, 2.0]}, "contact_force = .*1 finite"),
        ({"contact_force": [math.inf]}, "contact_force = "),
        ({"contact_surface": Surface("a", [math.inf], [1.0])}, "contact_surface"),
        ({"stop_time": -1.0}, "stop_time = -1.0"),
        ({"stop_time": math.nan}, "stop_time = nan"),
    ],
)
def test_bad_parameters(arguments, message):
    with pytest.raises(ValueError, match=message):
        ConstantVelocityOperator(**({"velocity": [0.1]} | arguments))


def test_commands_are_vectors_of_any_width():
    dut = ConstantVelocityOperator(velocity=np.arange(3.0))
    assert dut.GetOutputPort("force_command").size() == 3
