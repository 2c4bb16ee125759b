"""Blocks that are their kernels."""

import traceback

import numpy as np
import pytest
from blocks import Feedthrough
from pydrake.systems.framework import BasicVector

from teleop_drake.compiler.check import CheckKernel
from teleop_drake.kernel import Kernel, KernelBlock, times
from teleop_drake.validation import ScenarioError


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
