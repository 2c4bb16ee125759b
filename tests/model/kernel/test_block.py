"""Blocks that are their kernels."""

import math
import traceback

import numpy as np
import pytest
from block_checks import Feedthrough
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.framework import BasicVector
from pydrake.systems.primitives import Demultiplexer, FirstOrderTaylorApproximation
from wired import Wired

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.loops.kernel import Delay, Kernel, KernelBlock, times

EYE = np.eye(4)


def decay(x, bias, t):
    return bias * t - x


class Everything(KernelBlock):
    """Has a term of each sort; `unused` is connected to nothing."""

    def __init__(self):
        KernelBlock.__init__(self)
        self.DeclareVectorInputPort("u", 2)
        self.DeclareVectorInputPort("unused", 1)
        self.DeclareContinuousState(BasicVector([1.0, 2.0]))
        self.DeclareDiscreteState([5.0, 6.0])
        self.DeclareOutputs(whole=2, last=1, mode=1, force=2, joined=3, slope=2)

    def Kernel(self):
        return Kernel(
            parameters={"k": 3.0, "bias": np.array([1.0, 10.0])},
            rate=(decay, "state", "bias", "time"),
            outputs={
                "whole": "u",
                "last": ("state", 1, 2),
                "mode": ("mode", 0, 1),
                "force": (times, "stretch", "k"),
                "stretch": (times, "u", 2),
                "joined": ["force", ("bias", 1, 2)],
                "slope": "rate",
            },
            sizes={"stretch": 2},
            unused=("unused",),
        )


def test_callbacks_evaluate_the_terms():
    block = Everything()
    context = block.CreateDefaultContext()
    context.SetTime(0.5)
    block.GetInputPort("u").FixValue(context, [1.0, -1.0])
    values = {
        block.get_output_port(i).get_name(): block.get_output_port(i).Eval(context)
        for i in range(block.num_output_ports())
    }
    assert {name: value.tolist() for name, value in values.items()} == {
        "whole": [1.0, -1.0],
        "last": [2.0],
        "mode": [5.0],
        "force": [6.0, -6.0],
        "joined": [6.0, -6.0, 10.0],
        "slope": [-0.5, 3.0],
    }
    rate = block.EvalTimeDerivatives(context).CopyToVector()
    assert rate.tolist() == [-0.5, 3.0]
    # What is cached is renewed when time, state or mode change.
    context.SetTime(0.0)
    context.SetContinuousState([7.0, 8.0])
    context.SetDiscreteState([9.0, 6.0])
    assert block.GetOutputPort("slope").Eval(context).tolist() == [-7.0, -8.0]
    assert block.GetOutputPort("last").Eval(context).tolist() == [8.0]
    assert block.GetOutputPort("mode").Eval(context).tolist() == [9.0]


def test_an_output_feeds_through_what_its_term_takes():
    whole = {name: {"u"} for name in ("whole", "force", "joined")}
    assert Feedthrough(Everything()) == whole


def test_the_kernel_is_that_of_the_compiler():
    assert CheckKernel(Everything(), num_states=3) == []


def failing(x):
    raise ArithmeticError("as the law says")


class Spring(KernelBlock):
    def __init__(self, **terms):
        KernelBlock.__init__(self)
        self._terms = terms
        self.DeclareVectorInputPort("position", 1)
        self.DeclareContinuousState(1)
        self.DeclareOutputs(force=1)

    def Kernel(self):
        return Kernel(parameters={"k": 3.0}, **self._terms)


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ({"outputs": {"force": (times, "k", "postion")}}, "outputs.force = 'postion'"),
        ({"outputs": {"force": "k", "other": "postion"}}, "outputs.other = 'postion'"),
        ({"outputs": {"force": "k"}, "rate": ["postion"]}, "rate = 'postion'"),
    ],
)
def test_a_misspelt_name_is_refused_where_the_block_is_made(terms, message):
    with pytest.raises(ScenarioError) as error:
        Spring(**terms)
    assert f"Spring: {message}: must be one of position, " in str(error.value)
    assert "did you mean 'position'" in str(error.value)


def test_a_trace_shows_the_users_file_and_no_text_that_is_none():
    block = Spring(outputs={"force": (failing, "position")})
    context = block.CreateDefaultContext()
    block.GetInputPort("position").FixValue(context, [1.0])
    with pytest.raises(ArithmeticError) as error:
        block.GetOutputPort("force").Eval(context)
    frames = traceback.extract_tb(error.value.__traceback__)
    assert frames[-1].filename == __file__
    assert frames[-1].line == 'raise ArithmeticError("as the law says")'
    assert all(frame.line for frame in frames)


class Pendulum(KernelBlock):
    """x'' = u - g sin x |x|, and an inverse of a matrix that depends on the state."""

    def __init__(self, *, g):
        KernelBlock.__init__(self)
        self._g = g
        self.DeclareVectorInputPort("u", 1)
        self.DeclareContinuousState(1, 1, 0)
        self.DeclareOutputs(y=2)

    def Kernel(self):
        return Kernel(
            parameters={"g": self._g},
            rate=(swing, "state", "u", "g"),
            outputs={"y": (inverted, "state", "u")},
        )


def swing(x, u, g):
    return np.array([x[1], u[0] - g * np.sin(x[0]) * abs(x[0])])


def inverted(x, u):
    return np.linalg.inv(np.stack([x * [1, 0], x[::-1] * [1, 0] + [0, 2]])) @ [1, u[0]]


def test_drake_linearises_kernel_blocks_exactly():
    """Two in a row, against closed forms; NumPy's inv knows no AutoDiffXd."""
    diagram = Wired(
        {
            "first": Pendulum(g=3.0),
            "parts": Demultiplexer([1, 1]),
            "second": Pendulum(g=5.0),
        },
        {"parts": "first", "second": "parts.y1"},
        {"y": "second"},
        inputs={"u": "first"},
    )
    context = diagram.CreateDefaultContext()
    a, b, c, d = x = np.array([0.4, -0.7, -0.2, 1.1])
    context.SetContinuousState(x)
    diagram.get_input_port().FixValue(context, [0.3])
    linear = FirstOrderTaylorApproximation(diagram, context)
    # y = [1/a, (u - b/a)/2] of each, and u = y1 of the first for the second.
    y1 = [b / (2 * a**2), -1 / (2 * a), 0, 0]
    slopes = -3 * (math.cos(a) * a + math.sin(a)), 5 * (math.cos(c) * c + math.sin(c))
    assert_allclose(
        linear.A(),
        [[0, 1, 0, 0], [slopes[0], 0, 0, 0], [0, 0, 0, 1], y1 + slopes[1] * EYE[2]],
        atol=1e-14,
    )
    assert_array_equal(linear.B(), [[0], [1], [0], [0.5]])
    y = [-EYE[2] / c**2, (y1 + d / c**2 * EYE[2] - EYE[3] / c) / 2]
    assert_allclose(linear.C(), y, atol=1e-13)
    assert_array_equal(linear.D(), [[0], [0.25]])


def test_every_sort_of_term_converts():
    block = Everything().ToAutoDiffXd()
    context = block.CreateDefaultContext()
    context.SetTime(0.5)
    block.GetInputPort("u").FixValue(context, InitializeAutoDiff([1.0, -1.0]))
    context.SetDiscreteState(0, [5.0, 6.0])
    joined, mode, slope = (
        block.GetOutputPort(name).Eval(context) for name in ("joined", "mode", "slope")
    )
    assert ExtractGradient(joined).tolist() == [[6, 0], [0, 6], [0, 0]]
    assert ExtractValue(mode).ravel().tolist() == [5.0]
    assert ExtractValue(slope).ravel().tolist() == [0.5, 5.0]


class Late(KernelBlock):
    def __init__(self):
        KernelBlock.__init__(self)
        self.DeclareVectorInputPort("u", 1)
        self.DeclareOutputs(y=1)

    def Kernel(self):
        delay = Delay(signal="u", output="y", initial_value=[0.0], time=1.0)
        return Kernel(delays=[delay])


def test_a_delay_says_what_linearises_it():
    dual = Late().ToAutoDiffXd()
    context = dual.CreateDefaultContext()
    dual.get_input_port().FixValue(context, [0.0])
    with pytest.raises(ValueError, match=r"call teleop_drake\.LinearizePorts\(\)"):
        dual.get_output_port().Eval(context)
