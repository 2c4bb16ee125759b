"""Tests of teleop_drake.loops.numerics.jumps."""

import numpy as np
import pytest

from teleop_drake.loops.numerics.jumps import TooManyJumps, find_jumps


def test_jumps_are_enclosed_and_kinks_are_none():
    def function(t):
        return np.array([np.sin(3 * t) + 1e-3 * (t >= 0.3), abs(t - 0.6)])

    (jump,) = find_jumps(function, 0.0, 1.0, 8)
    assert jump.before < 0.3 <= jump.after
    assert jump.after - jump.before < 2e-12


def test_a_short_pulse_has_two_jumps():
    def function(t):
        return np.array([float(0.5 <= t < 0.51)])

    first, second = find_jumps(function, 0.0, 1.0, 32)
    assert first.after == pytest.approx(0.5, abs=2e-12)
    assert second.after == pytest.approx(0.51, abs=2e-12)


def test_noise_is_refused():
    with pytest.raises(TooManyJumps):
        find_jumps(lambda t: np.array([np.sin(1e9 * t * t)]), 0.0, 1.0, 4)
