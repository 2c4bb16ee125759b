"""The operator whose commands come from outside."""

import pytest

from teleop_drake.compiler.check import CheckKernel
from teleop_drake.operators.hand import HandOperator


def test_follows_the_line_that_is_set_and_holds_its_end():
    dut = HandOperator(num_axes=2)
    context = dut.CreateDefaultContext()
    port, line = dut.GetOutputPort("velocity_command"), dut.GetInputPort("line")
    assert port.Eval(context).tolist() == [0, 0]
    ends = [0.0, 0.1, 0.2, 0.1]
    line.FixValue(context, [1.0, 2.0, *ends])
    for time, expected in ((0.5, 0.0), (1.25, 0.05), (2.0, 0.2), (5.0, 0.2)):
        context.SetTime(time)
        assert port.Eval(context).tolist() == pytest.approx([expected, 0.1])
    # A change of the line alone is seen.
    line.FixValue(context, [4.0, 6.0, *ends])
    assert port.Eval(context).tolist() == pytest.approx([0.1, 0.1])


def test_its_kernel():
    CheckKernel(HandOperator(num_axes=2))
