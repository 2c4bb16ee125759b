"""Delays that vary with time: the sum of their parts, and when they are continuous."""

import math

import numpy as np
import pytest

from teleop_drake.channels.variable import DelayProfile, Sinusoid


def test_profile_adds_its_parts():
    times, values = [1000.0, 1000.5, 1002.0], [0.02, 0.05, 0.03]
    profile = DelayProfile(
        delay=0.1,
        drift=-0.001,
        sinusoid=Sinusoid(amplitude=0.01, frequency=3.0, phase=0.4),
        trace=(times, values),
    )
    assert profile.duration == 2.0
    for t in np.linspace(0, 2, 41):
        expected = 0.1 - 0.001 * t + 0.01 * math.sin(3 * t + 0.4)
        expected += np.interp(1000 + t, times, values)
        assert profile(t) == pytest.approx(expected, abs=1e-13)
    assert profile.minimum == pytest.approx(0.1 - 0.002 - 0.01 + 0.02)
    assert profile.max_slope == pytest.approx(-0.001 + 0.03 + 0.03 / 0.5)
    with pytest.raises(ValueError, match=r"t = 2.1: must be at most 2 s"):
        profile(2.1)


def test_beyond_the_trace_it_has_no_value_and_without_one_it_has_no_end():
    trace = DelayProfile(delay=0.0, trace=([3.0, 4.0], [0.1, 0.3]), duration=0.5)
    assert trace.duration == 0.5
    assert trace(0.5) == pytest.approx(0.2)
    constant = DelayProfile(delay=0.1)
    assert constant.duration == math.inf
    assert constant(1e9) == constant.minimum == constant.delay == 0.1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"delay": 0.0}, "delay = 0.0: must be .* never less than 1e-06 s"),
        ({"drift": 1.0}, "drift = 1.0: must be such that dT/dt, up to 1, is less"),
        (
            {"sinusoid": Sinusoid(amplitude=0.05, frequency=20.5)},
            "sinusoid.amplitude = 0.05: must be such that dT/dt, up to 1.025",
        ),
        ({"trace": ([0, 1, 1.01], [0.1, 0.1, 0.2])}, "trace = .*: must .* up to 10"),
    ],
)
def test_what_cannot_be_continuous(arguments, message):
    profile = DelayProfile(**({"delay": 0.1} | arguments))
    with pytest.raises(ValueError, match=message):
        profile.CheckContinuous(1e-6)
