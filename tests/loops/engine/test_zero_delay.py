"""Programs whose constant delays may be 0."""

import numpy as np
import pytest
from pydrake.systems.primitives import Gain, Integrator
from wired import Wired

from teleop_drake.loops import TransportDelay
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import AlgebraicLoop
from teleop_drake.loops.engine.parameters import SetNumbers
from teleop_drake.loops.engine.run import CompiledRun


def MakeLoop(delay):
    """dx/dt = -x(t - delay), x(0) = 1."""
    return Wired(
        {
            "state": Integrator([1.0]),
            "channel": TransportDelay(delay, 1),
            "minus": Gain(-1.0, 1),
        },
        {"channel": "state", "minus": "channel", "state": "minus"},
    )


def EndOf(diagram, context):
    evaluator = Evaluator(diagram, context, has_zero_delays=True)
    run = CompiledRun(evaluator, context, end=2.0, accuracy=1e-10, max_step=0.1)
    run.Sample(2.0)
    return evaluator.program, run.memory.x[0]


# By the method of steps: x is 1 until the first value arrives, and loses then what
# arrived.
@pytest.mark.parametrize(
    ("delay", "expected"),
    [(0.0, np.exp(-2.0)), (1.0, 0.0), (0.5, 1 - 1.5 + 1.0**2 / 2 - 0.5**3 / 6)],
    ids=["none", "1 s", "0.5 s"],
)
def test_one_program_has_all_delays(delay, expected):
    diagram = MakeLoop(1.0)
    context = diagram.CreateDefaultContext()
    other, _ = EndOf(diagram, context)
    SetNumbers(diagram, context, {"delay": delay})
    program, x = EndOf(diagram, context)
    assert program.structure == other.structure
    assert x == pytest.approx(expected, abs=1e-8)


def test_a_block_without_delay_computes_as_the_program_at_0():
    diagram = MakeLoop(0.0)
    _, x = EndOf(diagram, diagram.CreateDefaultContext())
    assert x == pytest.approx(np.exp(-2.0), abs=1e-8)


def test_a_loop_that_needs_its_delay_is_named():
    diagram = Wired(
        {"channel": TransportDelay(0.1, 1), "half": Gain(0.5, 1)},
        {"half": "channel", "channel": "half"},
    )
    context = diagram.CreateDefaultContext()
    Evaluator(diagram, context)
    with pytest.raises(AlgebraicLoop, match="depends on itself"):
        Evaluator(diagram, context, has_zero_delays=True)
