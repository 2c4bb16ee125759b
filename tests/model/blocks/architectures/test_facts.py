"""What an architecture may know: what is told is taken, what is not is refused."""

import dataclasses

import pytest

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.systems.haptic_device import HapticDeviceConfig
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.channels.transport import TransportChannelConfig
from teleop_drake.model.scenario import LoadScenario

UNTOLD = dict.fromkeys(
    ("inertia", "robot_damping", "environment_stiffness", "environment_damping")
)
DEVICE = HapticDeviceConfig(numerator=[25.0, 50.0], denominator=[1.0, 25.0, 0.0])


def Facts(**changes):
    return dataclasses.replace(LoadScenario("one_dof").Facts(), **changes)


def test_the_slider_and_its_tissue_tell_what_they_are():
    facts = Facts()
    assert facts.num_axes == 1
    told = {fact: facts.Told(fact, "x").item() for fact in UNTOLD}
    assert told == pytest.approx(dict(zip(UNTOLD, (0.5, 0.1, 0.01, 0.5), strict=True)))
    assert facts.StartDamping("x").item() == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("fact", "who"),
    [
        ("inertia", "robot does not report its inertia"),
        ("robot_damping", "robot does not report its damping"),
        ("environment_stiffness", "environment does not report its stiffness"),
    ],
)
def test_what_is_not_told_is_not_guessed(fact, who):
    with pytest.raises(ScenarioError, match=rf"^controller.mass = null: .*{who}"):
        Facts(**UNTOLD).Told(fact, "controller.mass")


def test_a_damping_that_is_not_told_is_not_guessed():
    half = Facts(environment_damping=None)
    with pytest.raises(ScenarioError, match="environment does not report its damping"):
        half.StartDamping("controller.damping")


def test_delays():
    facts = Facts()
    assert facts.round_trip == pytest.approx(0.2)
    assert not facts.has_no_delay
    none = TransportChannelConfig(delay=0.0)
    assert not Facts(forward_channel=none).has_no_delay
    assert Facts(forward_channel=none, return_channel=none).has_no_delay


def test_the_round_trip_over_a_trace_is_its_mean(tmp_path):
    """A delay of 0 and a trace: defaults derived from no delay at all."""
    trace = tmp_path / "t.csv"
    trace.write_text("time_s,delay_ms\n0,40\n5,40\n10,80\n")
    channel = NetworkChannelConfig(
        delay=0.0, sample_period=0.01, trace=str(trace), trace_end="hold"
    )
    back = TransportChannelConfig(delay=0.01)
    facts = Facts(forward_channel=channel, return_channel=back, duration=10.0)
    assert facts.round_trip == pytest.approx(0.05 + 0.01, abs=1e-6)


def test_the_device():
    """H = 2/s + 23/(s + 25)."""
    facts = Facts(haptic_device=DEVICE)
    assert facts.OperatorResistance("x") == pytest.approx(0.92)
    assert facts.DeviceGain() == pytest.approx(25.0)
    assert facts.DevicePole() == pytest.approx(25.0)
    facts.CheckStrictlyProper("waves")
    spring = HapticDeviceConfig(numerator=[50.0], denominator=[1.0, 0.0])
    with pytest.raises(ScenarioError, match=r"^x = null: must be a number, because"):
        Facts(haptic_device=spring).OperatorResistance("x")
    damper = HapticDeviceConfig(numerator=[1.0, 2.0], denominator=[1.0, 3.0])
    with pytest.raises(ScenarioError, match=r"haptic_device.numerator = \[1.0, 2.0\]"):
        Facts(haptic_device=damper).CheckStrictlyProper("waves")
