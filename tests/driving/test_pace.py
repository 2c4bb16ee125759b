"""The pace, with a clock that is turned by hand."""

import math

import pytest

from teleop_drake.driving.pace import Pace


class Clock:
    """A clock that goes on only while somebody sleeps or works."""

    def __init__(self):
        self.time, self.slept = 100.0, 0.0

    def Sleep(self, duration):
        self.time += duration
        self.slept += duration


def MakePace(rate):
    clock = Clock()
    return clock, Pace(rate, now=lambda: clock.time, sleep=clock.Sleep)


@pytest.mark.parametrize("rate", [1.0, 0.5])
def test_waits_for_the_wall(rate):
    clock, pace = MakePace(rate)
    pace.Start(3.0)
    for i in range(1, 11):
        clock.time += 0.01  # The work of a picture.
        pace.Wait(3.0 + 0.1 * i)
    assert clock.time == pytest.approx(100.0 + 1.0 / rate)
    assert pace.MeasuredRate(4.0) == pytest.approx(rate)
    assert not pace.was_late


def test_does_not_hurry_after_a_delay():
    clock, pace = MakePace(1.0)
    pace.Start(0.0)
    clock.time += 2.0  # Something took long.
    pace.Wait(0.1)
    assert pace.was_late
    assert clock.slept == 0
    pace.Wait(0.2)
    assert clock.slept == pytest.approx(0.1)
    assert pace.MeasuredRate(0.2) == pytest.approx(0.2 / 2.1)


def test_as_fast_as_it_goes():
    clock, pace = MakePace(math.inf)
    pace.Start(0.0)
    pace.Wait(1000.0)
    assert clock.slept == 0
    assert not pace.was_late
