"""The trapezoid against its closed form."""

import numpy as np
import pytest

from teleop_drake.operators.trapezoid import TrapezoidConfig


def Commands(times, **fields):
    config = TrapezoidConfig(velocity=np.array([0.2, -0.1]), **fields)
    dut = config.MakeOperator(start=[0.0, 0.0])
    context = dut.CreateDefaultContext()
    values = []
    for time in times:
        context.SetTime(time)
        values.append(dut.GetOutputPort("velocity_command").Eval(context).copy())
    return np.array(values), dut.jump_times


@pytest.mark.parametrize("cruise_time", [0.0, 0.3, None])
def test_rises_stays_and_falls(cruise_time):
    times = np.linspace(0.0, 2.0, 201)
    end = np.inf if cruise_time is None else 0.5 + cruise_time
    share = np.clip(np.minimum(times / 0.5, 1 - (times - end) / 0.5), 0, 1)
    values, nonsmooth_times = Commands(times, rise_time=0.5, cruise_time=cruise_time)
    np.testing.assert_allclose(values, np.outer(share, [0.2, -0.1]), atol=1e-12)
    assert len(nonsmooth_times) == {0.0: 2, 0.3: 3, None: 1}[cruise_time]
