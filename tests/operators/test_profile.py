"""The operator with a plan."""

import numpy as np
import pytest

from teleop_drake.operators.profile import ProfileOperator

LINES = {"breaks": [0.0, 1.0], "coefficients": [[[0.0, 1.0], [2.0, 0.0]]]}


def test_time_alone_decides():
    dut = ProfileOperator(**LINES, nonsmooth_times=[1.0], stop_time=2.0)
    assert dut.jump_times == [1.0, 2.0]
    context = dut.CreateDefaultContext()
    port = dut.GetOutputPort("velocity_command")
    assert port.Eval(context).tolist() == [0, 1]
    context.SetTime(0.25)
    assert port.Eval(context).tolist() == [0.5, 1]
    for name in ("haptic_force", "felt_position"):
        assert not dut.HasDirectFeedthrough(
            dut.GetInputPort(name).get_index(), port.get_index()
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"breaks": [0.0]}, "breaks = "),
        ({"breaks": [1.0, 0.0]}, "breaks = .*: must be ascending"),
        (
            {"coefficients": np.full((1, 2, 2), np.nan)},
            "coefficients = .*: must be finite",
        ),
    ],
)
def test_refused(change, message):
    with pytest.raises(ValueError, match=message):
        ProfileOperator(**LINES | change)
