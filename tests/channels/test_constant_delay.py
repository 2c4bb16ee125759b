"""Tests of the constant delays that stand for channels."""

import math

import pytest

from teleop_drake.scenario import LoadScenario, ScenarioError


def Delay(**channel):
    channel = {"delay": 0.1} | channel
    scenario = LoadScenario("one_dof", {"return_channel": channel, "duration": 20.0})
    channel = scenario.return_channel
    return channel.AsConstantDelay("return_channel", scenario.duration)


def test_transport_is_itself():
    assert Delay().delay == 0.1 and Delay().note is None


def test_held_samples_are_half_a_period_older():
    result = Delay(kind="sampled", sample_period=0.02)
    assert result.delay == pytest.approx(0.11)
    assert "packets are held for 0.02 s" in result.note
    nothing = Delay(kind="sampled", sample_period=0.02, delay=0.0)
    assert nothing.delay == 0 and nothing.note is None


def test_variable_is_its_mean():
    """Half a period of a sine has the mean 2/pi; a drift adds half of what it has."""
    sinusoid = {"amplitude": 0.03, "frequency": math.pi / 20}
    result = Delay(kind="variable", sinusoid=sinusoid, drift=0.001)
    assert result.delay == pytest.approx(0.1 + 0.03 * 2 / math.pi + 0.01, rel=1e-6)
    assert "varies from 0.1 to 0.14" in result.note


@pytest.mark.parametrize(
    ("receiver", "jitter", "expected"),
    [
        ({}, {}, 0.105),
        ({"policy": "playout", "depth": 0.05}, {}, 0.155),
        # Every packet is shown in time, so the jitter does not matter.
        (
            {"policy": "playout", "depth": 0.05},
            {"kind": "uniform", "std": 0.01},
            0.155,
        ),
    ],
)
def test_network_is_its_mean_age(receiver, jitter, expected):
    result = Delay(kind="network", sample_period=0.01, receiver=receiver, jitter=jitter)
    assert result.delay == pytest.approx(expected, rel=1e-3)
    assert "mean age" in result.note


def test_loss_makes_older():
    """Of a stream with independent losses p the mean age is d + h (1 + p)/(2 (1 - p)):
    the mean square over twice the mean of a geometric interval."""
    p, h = 0.3, 0.01
    result = Delay(
        kind="network",
        sample_period=h,
        loss={"kind": "independent", "probability": p},
    )
    expected = 0.1 + h / 2 * (1 + p) / (1 - p)
    assert result.delay == pytest.approx(expected, abs=5e-4)


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        (
            {"receiver": {"policy": "extrapolate"}},
            r"return_channel.receiver.policy = 'extrapolate': must be newest",
        ),
        (
            {"loss": {"kind": "independent", "probability": 1.0}},
            "return_channel: must deliver a packet within the duration, 20 s",
        ),
    ],
)
def test_refuses(channel, message):
    with pytest.raises(ScenarioError, match=message):
        Delay(kind="network", sample_period=0.01, **channel)
