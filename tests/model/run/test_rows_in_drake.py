"""Signals between the rows of runs, against closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Gain,
    Integrator,
    Saturation,
    Sine,
    TrajectorySource,
    WrapToSystem,
    ZeroOrderHold,
)
from pydrake.trajectories import PiecewisePolynomial
from wired import Wired

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.framework.signals import SignalsOf
from teleop_drake.loops.framework.solver import DefaultSimulator
from teleop_drake.model.blocks.environments.layered_force_field import (
    LayerConfig,
    LayeredForceField,
)
from teleop_drake.model.run.simulate import simulate


class PythonGain(LeafSystem):
    """y = 2 u in Python, for which there is no kernel."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("y", 1, self._CalcOutput)

    def _CalcOutput(self, context, output):
        output.SetFromVector(2 * self.get_input_port().Eval(context))


class Oscillator(LeafSystem):
    """x'' = -36 x, from x = 1 at rest."""

    def __init__(self):
        LeafSystem.__init__(self)
        index = self.DeclareContinuousState(2)
        self.DeclareStateOutputPort("state", index)

    def DoCalcTimeDerivatives(self, context, derivatives):
        x, v = context.get_continuous_state_vector().CopyToVector()
        derivatives.SetFromVector([v, -36 * x])


class Step(LeafSystem):
    """A plain function of time that steps from 0 to 1 at 0.5 s, without an event."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort(
            "y",
            1,
            lambda context, y: y.SetFromVector([float(context.get_time() >= 0.5)]),
            prerequisites_of_calc={self.time_ticket()},
        )


def Wrapped():
    """Returns a block that wraps its input to an interval from -1 to 1."""
    block = WrapToSystem(1)
    block.set_interval(0, -1.0, 1.0)
    return block


def chain(*systems):
    """Returns systems in a row; the last one's output is exported as `y`."""
    builder = DiagramBuilder()
    added = [builder.AddSystem(system) for system in systems]
    for source, target in pairwise(added):
        builder.Connect(source.get_output_port(0), target.get_input_port())
    builder.ExportOutput(added[-1].get_output_port(0), "y")
    return builder.Build()


def largest_error(recording, expected, name="y"):
    times = np.linspace(recording.time[0], recording.time[-1], 5001)
    found = recording.Interpolate(name, times)[:, 0]
    return np.abs(found - expected(times)).max()


def test_a_diagram_without_continuous_states_has_rows_where_its_signals_bend():
    diagram = chain(Sine(1.0, 6.0, 0.0, 1), PythonGain())
    recording = simulate(diagram, duration=2.0, engine="drake")
    assert largest_error(recording, lambda t: 2 * np.sin(6 * t)) < 2e-4


@pytest.mark.parametrize("longest", [None, 0.1])
def test_states_of_python_systems_are_interpolated_by_their_slopes(longest):
    system = Oscillator()
    context = system.CreateDefaultContext()
    context.SetContinuousState([1.0, 0.0])
    config = DefaultSimulator()
    if longest is not None:
        config.max_step_size = longest
    options = {"context": context, "duration": 2.0, "simulator": config}
    options["engine"] = "drake"
    recording = simulate(system, **options)
    assert largest_error(recording, lambda t: np.cos(6 * t), "state") < 1e-6


@pytest.mark.parametrize("frequency", [6.0, 40.0])
def test_a_kink_has_short_pieces_around_it(frequency):
    limit = Saturation(min_value=[-0.5], max_value=[0.5])
    diagram = chain(Sine(1.0, frequency, 0.0, 1), limit, PythonGain())
    recording = simulate(diagram, duration=2.0, engine="drake")

    def Expected(t):
        return 2 * np.clip(np.sin(frequency * t), -0.5, 0.5)

    assert largest_error(recording, Expected) < 2e-4
    assert not any("not accurate" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("blocks", "is_bent"),
    [
        ([Sine(1.0, 6.0, 0.0, 1), Saturation([-0.5], [0.5])], True),
        ([Sine(4.0, 6.0, 0.0, 1), Wrapped()], True),
        ([Sine(1.0, 60.0, 0.0, 1), TransportDelay(0.1, 1), Integrator(1)], False),
        ([Sine(1, 6, 0, 1), ZeroOrderHold(0.1, 1), TransportDelay(0.13, 1)], False),
    ],
)
def test_a_compiled_run_names_the_signals_that_bend_within_a_step(blocks, is_bent):
    recording = simulate(chain(*blocks), duration=2.0, engine="compiled")
    notes = [note for note in recording.notes if note.startswith("y: jumps or bends")]
    assert len(notes) == is_bent


@pytest.mark.parametrize("engine", ["drake", "compiled"])
@pytest.mark.parametrize(
    ("make", "is_bent"),
    [
        (lambda: Saturation(min_value=[-0.5], max_value=[0.5]), True),
        (Wrapped, True),
        (lambda: Gain(1.0, 1), False),
        (lambda: ZeroOrderHold(0.2, 1), False),
    ],
    ids=["kink", "jump", "smooth", "events"],
)
def test_a_delay_that_smooths_a_bend_is_named(make, is_bent, engine):
    """Nothing but the integral of the delayed signal is recorded."""
    late = TransportDelay(0.1, 1)
    late.set_name("late")
    diagram = chain(Sine(2.0, 6.0, 0.0, 1), make(), late, Integrator(1))
    recording = simulate(diagram, duration=0.7, engine=engine)
    notes = [x for x in recording.notes if x.startswith("late.signal: jumps or bends")]
    assert len(notes) == is_bent


def test_a_jump_without_an_event_is_enclosed_and_named():
    diagram = chain(Step(), PythonGain())
    recording = simulate(diagram, duration=1.0, engine="drake")
    times = np.array([0.0, 0.49999, 0.50001, 1.0])
    y = recording.Interpolate("y", times)[:, 0]
    assert_allclose(y, [0.0, 0.0, 2.0, 2.0], atol=1e-12)
    (note,) = [note for note in recording.notes if "not accurate" in note]
    assert note.startswith("y: jumps or bends")


def test_a_held_signal_jumps_at_its_samples():
    diagram = chain(Sine(1.0, 6.0, 0.0, 1), ZeroOrderHold(0.2, 1), PythonGain())
    recording = simulate(diagram, duration=2.0, engine="drake")
    times = np.linspace(0.001, 1.999, 1999)
    held = 0.2 * np.floor(times / 0.2 + 1e-9)
    inner = np.abs(times - 0.2 * np.round(times / 0.2)) > 1e-6
    y = recording.Interpolate("y", times[inner])[:, 0]
    assert_allclose(y, 2 * np.sin(6 * held[inner]), atol=1e-12)


def test_a_wall_is_felt_in_a_diagram_without_continuous_states():
    """A sine of 1 m enters a wall at 0.5 m with 90 N/m: 45 N at most."""
    bone = LayerConfig(name="bone", start=0.5, stiffness=90.0, reference=0.5)
    diagram = Wired(
        {
            "hand": Sine(1.0, 6.0, 0.0, 1),
            "wall": LayeredForceField([bone], 1),
            "twice": PythonGain(),
        },
        {
            "wall.tool_position": "hand.y0",
            "wall.tool_velocity": "hand.y1",
            "twice": "wall.environment_force",
        },
        {"y": "twice"},
    )
    recording = simulate(diagram, duration=2.0, engine="drake")

    def Expected(t):
        return 2 * 90 * np.maximum(np.sin(6 * t) - 0.5, 0)

    assert largest_error(recording, Expected) < 90e-4


class Noise(LeafSystem):
    """A function of time that differs from instant to instant."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort(
            "y",
            1,
            lambda context, y: y.SetFromVector([np.sin(1e9 * context.get_time())]),
            prerequisites_of_calc={self.time_ticket()},
        )


def BallOnTheGround():
    """Returns a Diagram in which a ball of 1 kg rolls, spins and bounces."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(0.05))
    ball = plant.AddRigidBody("ball", inertia)
    friction = CoulombFriction(0.5, 0.5)
    below = RigidTransform([0.0, 0.0, -0.5])
    world = plant.world_body()
    pose = RigidTransform()
    plant.RegisterCollisionGeometry(ball, pose, Sphere(0.05), "ball", friction)
    plant.RegisterCollisionGeometry(world, below, Box(2, 2, 1), "ground", friction)
    plant.Finalize()
    ports = {
        "state": plant.get_state_output_port(),
        "acceleration": plant.get_generalized_acceleration_output_port(),
    }
    for name, port in ports.items():
        builder.ExportOutput(port, name)
    return builder.Build()


def test_the_acceleration_of_a_body_in_contact_is_that_of_its_state():
    """In the rows it is so to the last bit, between them to 1e-4 of its range."""
    diagram = BallOnTheGround()
    context = diagram.CreateDefaultContext()
    start = [1, 0, 0, 0, 0, 0, 0.06, 0, 5, 0, 0.3, 0, 0]
    context.SetContinuousState(np.array(start, float))
    recording = simulate(diagram, context=context, duration=0.1)
    spread = np.ptp(recording["acceleration"])
    assert spread > 1000
    times = np.linspace(0.0, 0.1, 501)
    between = [recording.Interpolate(x, times) for x in ("state", "acceleration")]
    rows = [recording["state"], recording["acceleration"]]
    for (states, found), tolerance in ((rows, 0.0), (between, 1e-4 * spread)):
        expected = []
        for state in states:
            context.SetContinuousState(state)
            expected.append(diagram.GetOutputPort("acceleration").Eval(context))
        np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def test_noise_is_named_and_costs_little():
    recording = simulate(chain(Noise(), PythonGain()), duration=1.0, engine="drake")
    (note,) = [note for note in recording.notes if "not accurate" in note]
    assert note.startswith("y: jumps or bends")
    assert len(recording.time) < 10_000


@pytest.mark.parametrize(
    ("breaks", "values", "integral"),
    [
        ([0.0, 0.5037, 2.0], [1.0, 0.5, 0.5], 0.5037 + 0.5 * 0.3963),
        ([0.0, 0.5, 0.501, 2.0], [0.0, 4.0, 0.0, 0.0], 0.004),
    ],
)
def test_a_delay_has_the_jumps_of_a_trajectory(breaks, values, integral):
    """Pieces are constant; behind a delay of 0.1 s an integrator adds them up."""
    path = PiecewisePolynomial.ZeroOrderHold(breaks, [values])
    delay = TransportDelay(0.1, 1)
    diagram = chain(TrajectorySource(path), delay, Integrator(1))
    recording = simulate(diagram, duration=1.0, engine="drake")
    assert recording["y"][-1, 0] == pytest.approx(integral, abs=1e-8)


def test_a_delay_has_the_jump_of_a_function_in_python():
    recording = simulate(chain(Step(), TransportDelay(0.1, 1)), duration=1.0)
    times = np.array([0.59999, 0.60001, 0.7])
    late = recording.Interpolate("y", times)[:, 0]
    assert_allclose(late, [0.0, 1.0, 1.0], atol=1e-12)


def test_a_source_of_noise_is_no_source_of_jumps():
    diagram = chain(Noise(), TransportDelay(0.1, 1))
    assert simulate(diagram, duration=0.3).termination == "completed"


class Table(LeafSystem):
    """A table of a value for each 0.25 s of a run of 1 s, and none behind it."""

    def __init__(self):
        LeafSystem.__init__(self)
        values = [0.0, 2.0, 2.0, 2.0, 2.0]
        self.DeclareVectorOutputPort(
            "y",
            1,
            lambda context, y: y.SetFromVector(
                [values[int(context.get_time() // 0.25)]]
            ),
            prerequisites_of_calc={self.time_ticket()},
        )


def test_a_source_may_end_with_the_run():
    """Its jump at 0.25 s is found, although the search goes on behind the end."""
    diagram = chain(Table(), TransportDelay(0.1, 1), Integrator(1))
    recording = simulate(diagram, duration=1.249, engine="drake")
    assert recording["y"][-1, 0] == pytest.approx(2 * (1.249 - 0.35), abs=1e-8)


class Counter(LeafSystem):
    """Counts samples of 0.1 s; its output has the count and counts the calls."""

    def __init__(self, *, is_abstract):
        LeafSystem.__init__(self)
        self.num_calls = 0
        self._is_abstract = is_abstract
        if is_abstract:
            state = self.DeclareAbstractState(AbstractValue.Make(0.0))
            self.DeclarePeriodicUnrestrictedUpdateEvent(0.1, 0.1, self._Count)
            tickets = {self.abstract_state_ticket(state)}
        else:
            self.DeclareDiscreteState(1)
            self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.1, self._Count)
            tickets = {self.xd_ticket()}
        self.DeclareVectorOutputPort("y", 1, self._CalcOutput, tickets)

    def _Of(self, context):
        if self._is_abstract:
            return context.get_abstract_state(0).get_value()
        return context.get_discrete_state_vector()[0]

    def _Count(self, context, state):
        count = self._Of(context) + 1
        if self._is_abstract:
            state.get_mutable_abstract_state(0).set_value(count)
        else:
            state.set_value(0, [count])

    def _CalcOutput(self, context, output):
        self.num_calls += 1
        output.SetFromVector([self._Of(context)])


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("is_abstract", [False, True])
def test_a_held_output_is_a_staircase_evaluated_once_a_step(is_abstract, moves):
    builder = DiagramBuilder()
    counter = builder.AddNamedSystem("counter", Counter(is_abstract=is_abstract))
    if moves:
        builder.AddNamedSystem("oscillator", Oscillator())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([1.0, 0.0] * moves)
    y = counter.get_output_port()
    signals = {**SignalsOf(diagram), "again": y}
    recording = simulate(
        diagram, context=context, duration=0.95, engine="drake", signals=signals
    )
    assert_array_equal(recording["again"], recording["counter.y"])
    # Also just beside the jumps, and a first step that holds.
    times = np.r_[0.0, 0.0999, 0.1001, 0.45, 0.7999, 0.8001, 0.95]
    counts = recording.Interpolate("counter.y", times)[:, 0]
    assert counts == pytest.approx(np.floor(times * 10), abs=1e-12)
    assert counter.num_calls < 25
    if moves:
        x = recording.Interpolate("oscillator.state", times)[:, 0]
        assert x == pytest.approx(np.cos(6 * times), abs=1e-7)
