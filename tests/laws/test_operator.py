"""The operator's intentions (2.5): a velocity, then a force, then nothing."""

import numpy as np
import pytest

from teleop_drake.laws.operator import force_command, operator_mode, velocity_command

VELOCITY, HAPTIC, CONTACT = (np.array(x) for x in ([0.1, 0], [3.0, 4.0], [0.2, 0.0]))
NOTHING = np.zeros(2)


@pytest.mark.parametrize(
    ("perceived", "stopped", "mode", "velocity", "force"),
    [
        (0, 0, 0, VELOCITY, HAPTIC),
        (1, 0, 1, NOTHING, CONTACT),
        # The haptic device brakes the tool.
        (0, 1, 2, NOTHING, HAPTIC),
        (1, 1, 2, NOTHING, NOTHING),
    ],
)
def test_modes(perceived, stopped, mode, velocity, force):
    state = np.array([perceived, stopped], dtype=float)
    assert operator_mode(state) == mode
    np.testing.assert_array_equal(velocity_command(state, VELOCITY), velocity)
    np.testing.assert_array_equal(force_command(state, HAPTIC, CONTACT), force)
