"""No event of a block is dropped: a block with more than its kernel runs in Drake."""

import cProfile
import gc
import pstats
from dataclasses import dataclass

import pytest
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator, SimulatorConfig
from pydrake.systems.framework import (
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    UnrestrictedUpdateEvent,
    WitnessFunctionDirection,
)
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Gain,
    Integrator,
    LinearSystem,
    LogVectorOutput,
    PassThrough,
    Saturation,
    VectorLogSink,
    ZeroOrderHold,
)
from wired import Wired

from teleop_drake import simulate
from teleop_drake.loops.engine.block_events import CheckEvents
from teleop_drake.loops.engine.block_kernels import KernelOf
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.kernel import Kernel, KernelBlock, Transition
from teleop_drake.model.blocks.architectures import ControlLawConfig
from teleop_drake.model.run.simulate import MakeDiagram
from teleop_drake.model.scenario import LoadScenario

# In s and N.
PERIOD = 0.1
END = 0.95
PUSH = 5e-4


def reset(context, state):
    state.get_mutable_continuous_state().SetFromVector([0.0])


def reset_when_past(context, state):
    if context.get_continuous_state_vector()[0] < 0.3:
        return EventStatus.DidNothing()
    reset(context, state)
    return EventStatus.Succeeded()


class Refilled(Integrator):
    def __init__(self):
        Integrator.__init__(self, 1)
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, reset)


class Filled(KernelBlock):
    """x' = u, y = x."""

    def __init__(self):
        KernelBlock.__init__(self)
        self.DeclareVectorInputPort("u", 1)
        self.DeclareContinuousState(1)
        self.DeclareOutputs(y=1)

    def Kernel(self):
        return Kernel(outputs={"y": "state"}, rate="u")


class FilledAndReset(Filled):
    def __init__(self):
        Filled.__init__(self)
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, reset)


class FilledAndWatched(Filled):
    def __init__(self):
        Filled.__init__(self)
        self._full = self.MakeWitnessFunction(
            "full",
            WitnessFunctionDirection.kNegativeThenNonNegative,
            lambda context: context.get_continuous_state_vector()[0] - 0.3,
            UnrestrictedUpdateEvent(
                lambda context, event, state: reset(context, state)
            ),
        )

    def DoGetWitnessFunctions(self, context):
        return [self._full]


class FilledLeaf(LeafSystem):
    """x' = u, y = x, with callbacks of its own and an event."""

    def __init__(self, declare):
        LeafSystem.__init__(self)
        self._u = self.DeclareVectorInputPort("u", 1)
        self.DeclareContinuousState(1)
        self.DeclareVectorOutputPort("y", 1, self._CalcY, {self.xc_ticket()})
        declare(self)

    def _CalcY(self, context, output):
        output.SetFromVector(context.get_continuous_state_vector().CopyToVector())

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector(self._u.Eval(context))

    def Kernel(self):
        return Kernel(outputs={"y": "state"}, rate="u")


def integrator_with_an_event():
    block = Integrator(1)
    block.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, reset)
    return block


def late_event(block):
    block.DeclarePeriodicUnrestrictedUpdateEvent(1e6, 0.7, reset)


def event_of_each_step(block):
    block.DeclarePerStepUnrestrictedUpdateEvent(reset_when_past)


BLOCKS = {
    "instance of a primitive": integrator_with_an_event,
    "subclass of a primitive": Refilled,
    "subclass of a KernelBlock": FilledAndReset,
    "witness of a KernelBlock": FilledAndWatched,
    "late event of a LeafSystem": lambda: FilledLeaf(late_event),
    "per-step event of a LeafSystem": lambda: FilledLeaf(event_of_each_step),
}


def integrated(block):
    """Returns a diagram that integrates a constant 1."""
    return Wired(
        {"source": ConstantVectorSource([1.0]), "block": block},
        {"block": "source"},
        {"y": "block"},
    )


@pytest.mark.mostly_slow
@pytest.mark.parametrize("make", BLOCKS.values(), ids=BLOCKS)
def test_a_block_with_another_event_runs_in_drake(make):
    config = SimulatorConfig(integration_scheme="runge_kutta5", max_step_size=1e-3)
    recording = simulate(integrated(make()), duration=END, simulator=config)
    assert recording.solver.engine == "drake"
    assert any("'block' cannot be compiled" in note for note in recording.notes)
    simulator = Simulator(integrated(make()))
    simulator.get_mutable_integrator().set_maximum_step_size(1e-3)
    simulator.get_mutable_context().SetAccuracy(1e-6)
    simulator.AdvanceTo(END)
    expected = simulator.get_context().get_continuous_state_vector()[0]
    assert expected < 0.5
    assert recording["y"][-1, 0] == pytest.approx(expected, abs=3e-3)


def no_event(block):
    pass


@pytest.mark.parametrize(
    "make", [lambda: Integrator(1), Filled, lambda: FilledLeaf(no_event)]
)
def test_a_block_without_another_event_is_compiled(make):
    recording = simulate(integrated(make()), duration=END)
    assert recording.solver.engine == "compiled"
    assert recording["y"][-1, 0] == pytest.approx(END)


def published(context):
    return EventStatus.DidNothing()


def updated(context, values):
    return EventStatus.DidNothing()


# The declarations of events, each with its arguments.
DECLARATIONS = {
    "DeclarePeriodicPublishEvent": (0.1, 0.0, published),
    "DeclarePeriodicDiscreteUpdateEvent": (0.1, 0.0, updated),
    "DeclarePeriodicUnrestrictedUpdateEvent": (0.1, 0.0, updated),
    "DeclarePerStepPublishEvent": (published,),
    "DeclarePerStepDiscreteUpdateEvent": (updated,),
    "DeclarePerStepUnrestrictedUpdateEvent": (updated,),
}

# Those that have, or may have, events of their own among them.
RECEIVERS = {
    "Gain": lambda: Gain(2.0, 1),
    "Saturation": lambda: Saturation([-1.0], [1.0]),
    "ZeroOrderHold": lambda: ZeroOrderHold(0.1, 1),
    "LinearSystem": lambda: LinearSystem([[0.5]], [[1]], [[1]], [[0]], 0.1),
    "KernelBlock": Filled,
    "LeafSystem": lambda: FilledLeaf(no_event),
}


def Check(block):
    context = block.CreateDefaultContext()
    CheckEvents(block, KernelOf(block, context), context)


@pytest.mark.parametrize("declaration", DECLARATIONS)
@pytest.mark.parametrize("receiver", RECEIVERS)
def test_each_kind_of_event_is_noticed(declaration, receiver):
    block = RECEIVERS[receiver]()
    Check(block)
    getattr(block, declaration)(*DECLARATIONS[declaration])
    with pytest.raises(UnsupportedSystem, match="its kernel does not know"):
        Check(block)


class Sampled(LeafSystem):
    """Takes its input each 0.1 s; `extra` is called at the same instants."""

    def __init__(self, *, extra):
        LeafSystem.__init__(self)
        self._u = self.DeclareVectorInputPort("u", 1)
        self.DeclareStateOutputPort("y", self.DeclareDiscreteState(1))
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self._Take)
        if extra:
            self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, updated)

    def _Take(self, context, values):
        values.set_value(0, self._u.Eval(context))

    def Kernel(self):
        takes = Transition(mode="u", period=0.1, is_discrete=True)
        return Kernel(outputs={"y": "mode"}, transitions={"takes": takes})


class Counter(LeafSystem):
    """m' = m + 1 each `period` from `offset` on, of which the kernel says otherwise."""

    def __init__(self, period, offset, transition):
        LeafSystem.__init__(self)
        self._transition = transition
        self.num_calls = 0
        self.DeclareStateOutputPort("y", self.DeclareDiscreteState(1))
        self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._Count)

    def _Count(self, context, values):
        self.num_calls += 1
        values.set_value(0, context.get_discrete_state_vector().value() + 1.0)

    def Kernel(self):
        counts = Transition(
            mode=(one_more, "mode"), is_discrete=True, **self._transition
        )
        return Kernel(outputs={"y": "mode"}, transitions={"counts": counts})


def one_more(mode):
    return mode + 1.0


@pytest.mark.parametrize(
    ("period", "offset", "transition", "count"),
    [
        (0.2, 0.0, {"period": 0.1}, 6),
        (0.1, 0.0, {"period": 0.2}, 11),
        (0.1, 0.05, {"period": 0.1}, 10),
        (0.1, 0.0, {"period": 0.1, "offset": 0.05}, 11),
        (0.1, 0.1, {"period": 0.1}, 10),
    ],
)
def test_an_event_at_other_times_than_in_the_kernel_runs_in_drake(
    period, offset, transition, count
):
    recording = simulate(Counter(period, offset, transition), duration=1.02)
    assert recording.solver.engine == "drake"
    assert recording["y"][-1] == count


def test_a_kernel_with_the_events_of_its_block_is_compiled():
    block = Counter(0.1, 0.05, {"period": 0.1, "offset": 0.05})
    recording = simulate(block, duration=1.02)
    assert recording.solver.engine == "compiled"
    assert recording["y"][-1] == 10
    assert block.num_calls < 20  # It has some 1000 ticks in its trial run.


def bare():
    """Returns a LeafSystem that is no instance of a subclass, with an input."""
    block = LeafSystem()
    block.DeclareVectorInputPort("u", 1)
    return block


SINKS = {"LeafSystem": bare, "VectorLogSink": lambda: VectorLogSink(1)}

# The kinds of events that end a run, each with its period and offset.
ENDINGS = {
    "DeclarePeriodicPublishEvent": (0.01, 0.0),
    "DeclarePerStepPublishEvent": (),
    "DeclarePerStepDiscreteUpdateEvent": (),
    "DeclarePeriodicUnrestrictedUpdateEvent": (0.01, 0.0),
}


@pytest.mark.parametrize("declaration", ENDINGS)
@pytest.mark.parametrize("sink", SINKS)
def test_an_event_of_a_system_that_nothing_depends_on_is_executed(sink, declaration):
    watch = SINKS[sink]()

    def EndAbove(context, *_):
        if watch.get_input_port(0).Eval(context)[0] > 0.5:
            return EventStatus.ReachedTermination(watch, "above 0.5")
        return EventStatus.DidNothing()

    getattr(watch, declaration)(*ENDINGS[declaration], EndAbove)
    diagram = Wired(
        {"source": Integrator(1), "one": ConstantVectorSource([1.0]), "watch": watch},
        {"source": "one", "watch": "source"},
    )
    recording = simulate(diagram, duration=1.0)
    assert recording.termination == "terminated"
    assert recording.time[-1] == pytest.approx(0.5, abs=0.11)


@pytest.mark.parametrize("engine", ["auto", "drake"])
@pytest.mark.parametrize("kind", ["Publish", "DiscreteUpdate", "UnrestrictedUpdate"])
def test_an_initialization_event_may_end_the_run(kind, engine):
    watch = bare()

    def End(context, *_):
        return EventStatus.ReachedTermination(watch, "at once")

    getattr(watch, f"DeclareInitialization{kind}Event")(End)
    context = watch.CreateDefaultContext()
    watch.get_input_port(0).FixValue(context, [0.0])
    recording = simulate(watch, context=context, duration=1.0, engine=engine)
    assert recording.termination == "terminated"
    assert recording.time.tolist() == [0.0]


def test_a_log_without_an_event_of_a_user_is_left_out():
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", Integrator(1))
    one = builder.AddNamedSystem("one", ConstantVectorSource([1.0]))
    builder.Connect(one.get_output_port(), source.get_input_port())
    for period in (0.0, 0.01):
        LogVectorOutput(source.get_output_port(), builder, period)
    assert simulate(builder.Build(), duration=1.0).solver.engine == "compiled"


@pytest.mark.parametrize("declaration", DECLARATIONS)
def test_a_handler_is_not_called_before_the_run(declaration):
    *place, _ = DECLARATIONS[declaration]
    calls = []

    def Handle(*arguments):
        calls.append(arguments)

    def Declare(block):
        getattr(block, declaration)(*place, Handle)

    with pytest.raises(UnsupportedSystem, match=r"does not know the event Handle\(\)"):
        Check(FilledLeaf(Declare))
    assert calls == []


def test_a_second_event_at_the_instants_of_the_kernel_is_noticed():
    block = Sampled(extra=False)
    Check(block)
    block = Sampled(extra=True)
    with pytest.raises(UnsupportedSystem, match=r"does not know the event updated\(\)"):
        Check(block)


def test_an_unknown_base_is_not_taken_for_the_class():
    class Other(PassThrough):
        pass

    block = Other(1)
    with pytest.raises(UnsupportedSystem, match=r"Other .* offers no kernel"):
        KernelOf(block, block.CreateDefaultContext())


class DeadManLaw(LeafSystem):
    """Pushes until 0.2 s, then its switch releases; its kernel lacks that."""

    def __init__(self):
        LeafSystem.__init__(self)
        for name in (
            *("haptic_force", "velocity_command", "tool_position"),
            *("tool_velocity", "environment_force"),
        ):
            self.DeclareVectorInputPort(name, 1)
        self.DeclareDiscreteState([PUSH])
        self.DeclareVectorOutputPort(
            "control_force", 1, self._CalcForce, {self.xd_ticket()}
        )
        self.DeclarePerStepDiscreteUpdateEvent(self._Release)

    def _Release(self, context, values):
        if context.get_time() < 0.2:
            return EventStatus.DidNothing()
        values.set_value(0, [0.0])
        return EventStatus.Succeeded()

    def _CalcForce(self, context, output):
        output.SetFromVector(context.get_discrete_state_vector().value())

    def Kernel(self):
        inputs = [self.get_input_port(i).get_name() for i in range(5)]
        return Kernel(outputs={"control_force": "mode"}, unused=tuple(inputs))


@dataclass(kw_only=True, eq=False)
class DeadMan(ControlLawConfig):
    def MakeControlLaw(self, facts, path):
        return DeadManLaw()


@pytest.mark.slow
def test_a_control_law_with_a_dead_man_switch_lets_go():
    scenario = LoadScenario("one_dof", [f"controller.kind={__name__}:DeadMan"])
    recording = simulate(scenario, duration=0.4)
    assert recording.solver.engine == "drake"
    force = recording["control_force"][:, 0]
    time = recording.time
    assert (force[time < 0.2] == PUSH).all()
    assert (force[time > 0.25] == 0.0).all()
    simulator = Simulator(MakeDiagram(scenario))
    simulator.get_mutable_context().SetAccuracy(1e-4)
    simulator.get_mutable_integrator().set_maximum_step_size(1e-3)
    simulator.AdvanceTo(0.4)
    diagram = simulator.get_system()
    robot = diagram.GetSubsystemByName("robot")
    own = robot.GetMyContextFromRoot(simulator.get_context())
    velocity = robot.GetOutputPort("tool_velocity").Eval(own)
    assert_allclose(recording["tool_velocity"][-1], velocity, rtol=0.02)


def test_the_garbage_collector_is_no_event():
    """Drake's callbacks make garbage, and collecting it calls functions of Python."""
    calls = []

    def Called(phase, info):
        calls.append(phase)

    gc.callbacks.append(Called)
    threshold = gc.get_threshold()
    gc.set_threshold(1)
    try:
        Check(FilledLeaf(no_event))
    finally:
        gc.set_threshold(*threshold)
        gc.callbacks.remove(Called)
    assert calls


def test_a_profiler_goes_on():
    profiler = cProfile.Profile()
    with profiler:
        Check(FilledLeaf(no_event))
        sorted([])  # Seen only by a profiler that goes on.
    names = {code for _, _, code in pstats.Stats(profiler).stats}
    assert "<built-in method builtins.sorted>" in names
