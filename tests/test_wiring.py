"""Tables of systems and connections become diagrams."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import Adder, Gain

from teleop_drake.loops.framework.wiring import OutputNames, Wire


def MakeDifference(**changes):
    """Makes out = a - 2 b, with b as a second output."""
    tables = {
        "inputs": {"a": ["sum.u0"], "b": ["double", "copy"]},
        "connections": {"sum.u1": "double"},
        "outputs": {"out": "sum", "b": "copy.y0"},
    }
    systems = {"double": Gain(-2.0, 1), "sum": Adder(2, 1), "copy": Gain(1.0, 1)}
    systems["copy"].set_name("own_name")
    return Wire(Diagram(), "difference", systems, **{**tables, **changes})


def test_a_table_is_wired():
    diagram = MakeDifference()
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("a").FixValue(context, [5.0])
    diagram.GetInputPort("b").FixValue(context, [1.5])
    assert diagram.get_name() == "difference"
    assert OutputNames(diagram) == ["out", "b"]
    assert [x.get_name() for x in diagram.GetSystems()] == ["double", "sum", "own_name"]
    outputs = [diagram.GetOutputPort(x).Eval(context) for x in ("out", "b")]
    assert_array_equal(np.ravel(outputs), [2.0, 1.5])


@pytest.mark.parametrize(
    "changes",
    [
        {"inputs": {"a": ["sum.u7"], "b": ["double"]}},
        {"connections": {"sum.u1": "double.y7"}},
        {"outputs": {"out": "sum.total"}},
    ],
)
def test_a_port_that_is_not_there_is_refused(changes):
    with pytest.raises(RuntimeError, match=r"u7|y7|total"):
        MakeDifference(**changes)
