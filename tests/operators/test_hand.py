"""The operator whose commands come from outside."""

import pytest

from teleop_drake.compiler.check import CheckKernel
from teleop_drake.operators.hand import HandOperator


def test_follows_the_line_that_is_set_and_holds_its_end():
    dut = HandOperator(num_axes=2)
    context = dut.CreateDefaultContext()
    port, line = dut.GetOutputPort("velocity_command"), dut.GetInputPort("line")
    assert port.Eval(context).tolist() == [0, 0]
    ends = {"before": [0.0, 0.1], "after": [0.2, 0.1]}
    line.FixValue(context, dut.Line(begin=1.0, end=2.0, **ends))
    for time, expected in ((0.5, 0.0), (1.25, 0.05), (2.0, 0.2), (5.0, 0.2)):
        context.SetTime(time)
        assert port.Eval(context).tolist() == pytest.approx([expected, 0.1])
    # A change of the line alone is seen.
    line.FixValue(context, dut.Line(begin=4.0, end=6.0, **ends))
    assert port.Eval(context).tolist() == pytest.approx([0.1, 0.1])


def test_its_kernel():
    CheckKernel(HandOperator(num_axes=2))


def test_refused():
    dut = HandOperator(num_axes=1)
    with pytest.raises(ValueError, match=r"end = 1.0: must be > 1.0"):
        dut.Line(begin=1.0, end=1.0, before=[0.0], after=[0.0])
    with pytest.raises(ValueError, match="velocity"):
        dut.Line(begin=0.0, end=1.0, before=[0.0], after=[float("nan")])
