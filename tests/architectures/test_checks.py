"""Checks that both sides of an architecture share."""

import math

import pytest

from teleop_drake.architectures.checks import (
    CheckFourChannel,
    CheckPassivity,
    CheckWavePath,
)
from teleop_drake.validation import ScenarioError


def test_what_is_allowed():
    CheckWavePath(1.0, None)
    CheckWavePath(1e-3, 5.0)
    CheckFourChannel(None, C1=-3.0, C2=0.0)
    CheckFourChannel(5.0)
    CheckPassivity(1, horizon=1e-3)


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: CheckWavePath(0.0, None), "scaling = 0.0: must be"),
        (lambda: CheckWavePath(1.01, None), "scaling = 1.01: must be"),
        (lambda: CheckWavePath(1.0, 0.0), "bandwidth = 0.0: must be"),
        (lambda: CheckWavePath(1.0, math.inf), "bandwidth = inf: must be"),
        (lambda: CheckFourChannel(None, C1=math.nan), "C1 = nan: must be"),
        (lambda: CheckFourChannel(-1.0), "acceleration_bandwidth = -1.0: must be"),
        (lambda: CheckPassivity(0), "num_axes = 0: must be a whole number >= 1"),
        (lambda: CheckPassivity(2, horizon=0.0), "horizon = 0.0: must be"),
    ],
)
def test_what_is_refused(check, message):
    with pytest.raises(ScenarioError, match=message):
        check()
