"""Power at the two ends of the communication."""

import numpy as np
import pytest

from teleop_drake.laws.channel_energy import energy_rates, port_power


def test_power_is_that_of_all_axes():
    F, v = np.array([1.0, 2.0, 3.0]), np.array([0.1, -0.2, 0.5])
    assert port_power(F, v) == pytest.approx(0.1 - 0.4 + 1.5)
    rates = energy_rates(F, v, -F, 2 * v)
    assert rates == pytest.approx([1.2, -2.4])
