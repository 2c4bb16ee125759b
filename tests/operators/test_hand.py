"""The operator whose commands come from outside."""

import pytest

from teleop_drake.operators.hand import HandOperator


def test_follows_the_line_that_is_set_and_holds_its_end():
    dut = HandOperator(num_axes=2)
    context = dut.CreateDefaultContext()
    port = dut.GetOutputPort("velocity_command")
    assert port.Eval(context).tolist() == [0, 0]
    line = {"before": [0.0, 0.1], "after": [0.2, 0.1]}
    dut.SetCommand(context, begin=1.0, end=2.0, **line)
    for time, expected in ((0.5, 0.0), (1.25, 0.05), (2.0, 0.2), (5.0, 0.2)):
        context.SetTime(time)
        assert port.Eval(context).tolist() == pytest.approx([expected, 0.1])
    # A change of the line alone is seen.
    dut.SetCommand(context, begin=4.0, end=6.0, **line)
    assert port.Eval(context).tolist() == pytest.approx([0.1, 0.1])


def test_refused():
    dut = HandOperator(num_axes=1)
    context = dut.CreateDefaultContext()
    with pytest.raises(ValueError, match=r"end = 1.0: must be > 1.0"):
        dut.SetCommand(context, begin=1.0, end=1.0, before=[0.0], after=[0.0])
    with pytest.raises(ValueError, match="velocity"):
        dut.SetCommand(context, begin=0.0, end=1.0, before=[0.0], after=[float("nan")])
