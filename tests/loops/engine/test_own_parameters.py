"""Numeric parameters that a user's LeafSystem has in its kernel by their indices."""

import pytest
from numpy.testing import assert_allclose
from pydrake.systems.framework import (
    BasicVector,
    LeafSystem,
    NumericParameterIndex,
)

from teleop_drake.loops import simulate
from teleop_drake.loops.engine.check import KernelDisagrees
from teleop_drake.loops.kernel import Kernel


def line(gain, offset, power, u):
    return gain * u**power + offset


class Line(LeafSystem):
    """y = gain u^power + offset, with two numeric parameters.

    DeclareNumericParameter() returns their indices 0 and 1 as plain ints.
    """

    def __init__(self, power=2.0):
        LeafSystem.__init__(self)
        self._power = power
        self.gain = self.DeclareNumericParameter(BasicVector([3.0]))
        self.offset = self.DeclareNumericParameter(BasicVector([0.5]))
        self._u = self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("y", 1, self._Calc)

    def Kernel(self):
        parameters = {
            "gain": self.gain,
            "offset": NumericParameterIndex(self.offset),
            "power": self._power,
        }
        term = (line, *parameters, "u")
        return Kernel(outputs={"y": term}, parameters=parameters)

    def _Calc(self, context, output):
        gain = context.get_numeric_parameter(self.gain).value()
        offset = context.get_numeric_parameter(self.offset).value()
        output.SetFromVector(line(gain, offset, self._power, self._u.Eval(context)))


def run(system, gain):
    context = system.CreateDefaultContext()
    system.GetInputPort("u").FixValue(context, [2.0])
    context.get_mutable_numeric_parameter(system.gain).SetAtIndex(0, gain)
    return simulate(system, context=context, duration=0.1, engine="compiled")


@pytest.mark.parametrize("power", [2.0, 2], ids=["float", "int that is no index"])
@pytest.mark.parametrize("gain", [3.0, -1.0])
def test_an_index_stands_for_the_value_in_the_context(gain, power):
    """The index 0 of the gain was taken for its value."""
    recording = run(Line(power), gain)
    assert_allclose(recording["y"], gain * 4.0 + 0.5, rtol=1e-15)


def test_an_int_that_could_be_an_index_is_one_and_found_to_be_wrong():
    with pytest.raises(KernelDisagrees, match=r"^Line: its kernel says y = \[1.9"):
        run(Line(power=1), 1.0)
