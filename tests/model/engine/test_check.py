"""The comparison with Drake's callbacks finds any difference of a user's kernel."""

import contextlib
import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, EventStatus, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource
from wired import Wired

from teleop_drake import simulate
from teleop_drake.loops.engine.check import CompareTransitions, KernelDisagrees
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.kernel import Kernel, Transition
from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.operators import ConstantVelocityOperator


def taken(gain, offset, u):
    return gain * u + offset


class Sampler(LeafSystem):
    """m' = 2 u each 0.1 s; y = m. Its kernel says m' = gain u + offset."""

    def __init__(self, *, is_discrete, gain=2.0, offset=0.0, end=math.inf, slip=0.0):
        LeafSystem.__init__(self)
        self._is_discrete = is_discrete
        self._gain = gain
        self._offset = offset
        self._end = end
        self._slip = slip
        self._u = self.DeclareVectorInputPort("u", 1)
        self.DeclareContinuousState(1)
        self.DeclareStateOutputPort("y", self.DeclareDiscreteState(1))
        declare = self.DeclarePeriodicUnrestrictedUpdateEvent
        if is_discrete:
            declare = self.DeclarePeriodicDiscreteUpdateEvent
        declare(0.1, 0.0, self._Take)

    def _Take(self, context, state):
        value = 2 * self._u.Eval(context)
        if self._is_discrete:
            state.set_value(0, value)
        else:
            state.get_mutable_discrete_state(0).SetFromVector(value)
            x = context.get_continuous_state_vector().CopyToVector() + self._slip
            state.get_mutable_continuous_state().SetFromVector(x)
        if context.get_time() > self._end:
            return EventStatus.ReachedTermination(self, "late")
        return EventStatus.Succeeded()

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector([0.0])

    def Kernel(self):
        takes = Transition(
            mode=(taken, "gain", "offset", "u"),
            period=0.1,
            is_discrete=self._is_discrete,
        )
        return Kernel(
            rate="zero",
            outputs={"y": "mode"},
            parameters={
                "gain": self._gain,
                "offset": self._offset,
                "zero": np.zeros(1),
            },
            transitions={"takes": takes},
        )


def run(block):
    """Simulates a block with the input 3 for 1.02 s."""
    diagram = Wired(
        {"source": ConstantVectorSource([3.0]), "block": block},
        {"block": "source"},
        {"y": "block"},
    )
    return simulate(diagram, duration=1.02)


@pytest.mark.parametrize("is_discrete", [True, False])
def test_a_right_update_is_compiled(is_discrete):
    recording = run(Sampler(is_discrete=is_discrete))
    assert recording.solver.engine == "compiled"
    assert recording["y"][-1] == 6.0


@pytest.mark.parametrize("is_discrete", [True, False])
@pytest.mark.parametrize("wrong", [{"gain": 1.0}, {"offset": 1e-7}])
def test_another_update_than_that_of_the_handler_is_found(is_discrete, wrong):
    with pytest.raises(KernelDisagrees, match="block: its kernel says mode after its"):
        run(Sampler(is_discrete=is_discrete, **wrong))


def test_an_update_that_differs_by_rounding_is_not_found():
    assert run(Sampler(is_discrete=True, offset=1e-12)).solver.engine == "compiled"


def test_a_handler_that_changes_the_continuous_state_is_found():
    with pytest.raises(KernelDisagrees, match="state after its event"):
        run(Sampler(is_discrete=False, slip=0.5))


def test_a_handler_that_ends_the_run_is_found():
    with pytest.raises(KernelDisagrees, match=r"the block ends the run at .*: late"):
        run(Sampler(is_discrete=True, end=1.0))


class Doubled(LeafSystem):
    """y = 2 u and z = 3 u, where an input may have any name."""

    def __init__(self, name, kernel):
        LeafSystem.__init__(self)
        self._kernel = kernel
        self._u = self.DeclareVectorInputPort(name, 1)
        self.DeclareContinuousState(1)
        self.DeclareVectorOutputPort("y", 1, self._CalcY)
        self.DeclareVectorOutputPort("z", 1, self._CalcZ)

    def _CalcY(self, context, output):
        output.SetFromVector(2 * self._u.Eval(context))

    def _CalcZ(self, context, output):
        output.SetFromVector(3 * self._u.Eval(context))

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector(self._u.Eval(context))

    def Kernel(self):
        return self._kernel


def twice(u):
    return 2 * u


def thrice(u):
    return 3 * u


@pytest.mark.parametrize(
    "name", ["state", "mode", "time", "rate", "k", "y", "z", "input"]
)
@pytest.mark.parametrize("is_connected", [True, False])
def test_an_input_may_have_any_name(name, is_connected):
    u = ("input", name)
    kernel = Kernel(
        parameters={"k": 7.0},
        outputs={"y": (twice, u), "z": (thrice, (u, 0, 1))},
        rate=u,
    )
    system = block = Doubled(name, kernel)
    if is_connected:
        builder = DiagramBuilder()
        source = builder.AddSystem(ConstantVectorSource([5.0]))
        builder.AddSystem(block)
        builder.Connect(source.get_output_port(), block.get_input_port())
        for port in ("y", "z"):
            builder.ExportOutput(block.GetOutputPort(port), port)
        system = builder.Build()
    context = system.CreateDefaultContext()
    if not is_connected:
        block.get_input_port().FixValue(context, [5.0])
    recording = simulate(system, context=context, duration=1.0)
    assert recording.solver.engine == "compiled"
    assert recording["y"][-1] == 10.0
    assert recording["z"][-1] == 15.0
    final = recording.final_context.get_continuous_state_vector()[0]
    assert final == pytest.approx(5.0)


@pytest.mark.parametrize("name", ["y", "z"])
def test_an_input_precedes_an_output_of_its_name(name):
    kernel = Kernel(outputs={"y": (twice, name), "z": (thrice, name)}, rate=name)
    block = Doubled(name, kernel)
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, [5.0])
    recording = simulate(block, context=context, duration=1.0)
    assert recording.solver.engine == "compiled"
    assert [recording["y"][-1], recording["z"][-1]] == [10.0, 15.0]


def test_an_input_that_has_the_name_of_a_word_is_explained():
    kernel = Kernel(
        outputs={"y": (twice, "state"), "z": (thrice, "state")}, rate="state"
    )
    diagram = Wired(
        {"source": ConstantVectorSource([5.0]), "block": Doubled("state", kernel)},
        {"block": "source"},
        {"y": "block.y"},
    )
    recording = simulate(diagram, duration=1.0)
    assert recording.solver.engine == "drake"
    assert recording["y"][-1] == 10.0
    assert '("input", "state")' in recording.notes[0]


def one_less(mode):
    return mode - 1.0


def contact_operator():
    """Returns an operator with a guard, in a Context whose inputs are 0.3."""
    block = ConstantVelocityOperator(
        velocity=[0.1],
        contact_force=[1.0],
        contact_surface=Surface("contact", np.array([0.5]), np.array([1.0])),
    )
    context = block.CreateDefaultContext()
    context.SetAccuracy(1e-4)
    for i in range(block.num_input_ports()):
        block.get_input_port(i).FixValue(context, [0.3])
    return block, context


@pytest.mark.parametrize("kind", ["guard", "mode"])
def test_another_transition_than_that_of_a_block_is_found(kind):
    """The callbacks of the block are made of the kernel that it had at first."""
    block, context = contact_operator()
    kernel = block.Kernel()
    ((name, first),) = kernel.transitions.items()
    assert first.guard is not None
    laws = {"guard": (twice, ("felt_position", 0, 1)), "mode": (one_less, "mode")}
    changes = {name: replace(first, **{kind: laws[kind]})}
    for transitions in (kernel.transitions, changes):
        block.Kernel = lambda x=transitions: replace(kernel, transitions=x)
        evaluator = Evaluator(block, context)
        delayed = np.zeros(evaluator.program.sizes[0])
        if transitions is changes:
            found = pytest.raises(KernelDisagrees, match=f"says {kind} of {name} = ")
        else:
            found = contextlib.nullcontext()
        with found:
            CompareTransitions(evaluator, block, context, delayed)
