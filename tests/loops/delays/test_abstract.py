"""Delays of poses and of objects: copies of values of any type."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import DiscreteTimeDelay, Integrator
from wired import InSeries, Wired

from teleop_drake.loops import AbstractDelay, ScenarioError, TransportDelay, simulate

DELAY = 0.25
PERIOD = 0.1


class Pose(LeafSystem):
    """Moves along x with a speed of 1 m/s."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareAbstractOutputPort(
            "value", lambda: Value(RigidTransform()), self._Calc, {self.time_ticket()}
        )

    def _Calc(self, context, output):
        output.set_value(RigidTransform([context.get_time(), 0.0, 0.0]))


class Times(LeafSystem):
    """A list to which each evaluation appends the time: the same object for ever."""

    def __init__(self):
        LeafSystem.__init__(self)
        self._times = [0.0]
        self.DeclareAbstractOutputPort(
            "value", lambda: Value([0.0]), self._Calc, {self.time_ticket()}
        )

    def _Calc(self, context, output):
        self._times.append(context.get_time())
        output.set_value(self._times)


class Place(LeafSystem):
    """Reads x of a pose, or the last element of a list."""

    def __init__(self, model):
        LeafSystem.__init__(self)
        self._value = self.DeclareAbstractInputPort("value", AbstractValue.Make(model))
        self.DeclareVectorOutputPort("x", 1, self._Calc)

    def _Calc(self, context, output):
        value = self._value.Eval(context)
        is_pose = isinstance(value, RigidTransform)
        output.SetFromVector([value.translation()[0] if is_pose else value[-1]])


def behind(source, delay, model):
    """Returns a Diagram of a source, a delay, what is read of it, and its integral."""
    parts = {
        "source": source,
        "delay": delay,
        "place": Place(model),
        "sum": Integrator(1),
    }
    return Wired(parts, InSeries(*parts), {"x": "place", "sum": "sum"})


def check(recording, start=0.0, before=-5.0):
    """Compares with the packets that are sent from the start on, each held."""
    times = np.linspace(recording.time[0], recording.time[-1], 80)[1:-1] + 1e-4
    sent = np.floor((times - DELAY) / PERIOD + 1e-9) * PERIOD
    first = np.ceil(start / PERIOD - 1e-9) * PERIOD
    right = np.where(sent < first - 1e-9, before, sent)
    x = recording.Interpolate("x", times)[:, 0]
    assert_allclose(x, right, atol=1e-12)


def pose_delay():
    return AbstractDelay(DELAY, PERIOD, RigidTransform([-5.0, 0.0, 0.0]))


def test_a_pose_is_delayed_and_its_jumps_are_located():
    recording = simulate(behind(Pose(), pose_delay(), RigidTransform()), duration=1.0)
    check(recording)
    held = np.diff([0.0, DELAY, *(DELAY + PERIOD * np.arange(1, 8)), 1.0])
    values = [-5.0, *(PERIOD * np.arange(8))]
    assert recording["sum"][-1, 0] == pytest.approx(held @ values, abs=1e-9)
    assert recording.notes == [
        "Run in Drake's Simulator: AbstractDelay 'delay' cannot be compiled: its "
        "outputs are no vectors."
    ]


def test_an_object_of_python_is_copied():
    """What the source does with it later does not change what is under way."""
    recording = simulate(
        behind(Times(), AbstractDelay(DELAY, PERIOD, [-5.0]), [0.0]), duration=0.7
    )
    check(recording)


def test_a_later_start_and_its_second_half():
    diagram = behind(Pose(), pose_delay(), RigidTransform())
    context = diagram.CreateDefaultContext()
    context.SetTime(3.02)
    first = simulate(diagram, context=context, duration=0.2)
    second = simulate(diagram, context=first.final_context, duration=0.6)
    for part in (first, second):
        check(part, start=3.02)


def test_a_multiple_of_the_period_is_what_drake_does():
    """Drake's own DiscreteTimeDelay, in Drake's own Simulator."""
    model = RigidTransform([-5.0, 0.0, 0.0])
    delays = [
        AbstractDelay(3 * PERIOD, PERIOD, model),
        DiscreteTimeDelay(PERIOD, 3, AbstractValue.Make(model)),
    ]
    found = []
    for delay in delays:
        diagram = behind(Pose(), delay, RigidTransform())
        simulator = Simulator(diagram)
        rows = []
        for time in np.arange(0.015, 1.0, 0.02):
            simulator.AdvanceTo(time)
            x = diagram.GetOutputPort("x").Eval(simulator.get_context())
            rows.append(x[0])
        found.append(rows)
    assert_allclose(*found, atol=1e-12)


def test_the_model_may_be_an_abstract_value():
    delay = AbstractDelay(0.0, PERIOD, AbstractValue.Make(RigidTransform()))
    output = delay.get_output_port().Allocate()
    assert isinstance(output.get_value(), RigidTransform)
    assert not delay.HasDirectFeedthrough(0, 0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: TransportDelay(0.1, AbstractValue.Make(RigidTransform())),
            "^size = 'a Value of RigidTransform': must be the width of a vector; Abstr",
        ),
        (lambda: TransportDelay(0.1, 2.5), "^size = 2.5: must be a whole number >= 1"),
        (lambda: TransportDelay(0.1, 0), "^size = 0: must be a whole number >= 1"),
        (lambda: TransportDelay(0.1, "two"), "^size = 'two': must be a whole number"),
        (lambda: AbstractDelay(-1, 0.1, [1]), "^delay = -1: must be 0 or a finite num"),
        (lambda: AbstractDelay(1, 0.0, [1]), "^sample_period = 0.0: must be a finite"),
    ],
)
def test_what_is_no_delay_is_refused(make, message):
    with pytest.raises(ScenarioError, match=message):
        make()
