"""Tests of teleop_drake.study.figures.latency."""

import numpy as np
import pytest

from teleop_drake.study.analysis.latency import EstimateLatency
from teleop_drake.study.figures.latency import PlotLatency

TIME = np.arange(300) * 0.02


def Signal(times):
    return np.sin(2.1 * times) + 0.6 * np.sin(5.3 * times + 1)


def test_the_picture_shows_signals_course_and_interval():
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(TIME))
    response = 2 * Signal(TIME - 0.2) + noise
    latency = EstimateLatency(TIME, Signal(TIME), response, lag="none", maximum=1.0)
    signals, course, search = PlotLatency(latency).axes
    command, measured, fitted = signals.lines
    assert command.get_ydata() == pytest.approx(2 * Signal(TIME[50:]), abs=0.1)
    assert measured.get_ydata() == pytest.approx(response[50:])
    assert fitted.get_ydata() == pytest.approx(response[50:], abs=0.25)
    points = course.containers[0].lines[0].get_ydata()
    assert points == pytest.approx(200, abs=25)
    (low, high), *_ = latency.found.intervals
    (band,) = search.patches
    assert band.get_x() == pytest.approx(1e3 * low)
    assert band.get_width() == pytest.approx(1e3 * (high - low))


def test_the_picture_of_what_cannot_be_told_has_no_dead_time():
    latency = EstimateLatency(TIME, TIME, TIME - 0.2, lag="none", maximum=1.0)
    _, course, search = PlotLatency(latency).axes
    assert not course.containers
    (band,) = search.patches
    assert band.get_width() == pytest.approx(1000, rel=0.01)
