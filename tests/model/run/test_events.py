"""The run of a System has the events that its blocks locate, and is saved with them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.primitives import Demultiplexer, Integrator, LinearSystem
from wired import Wired

from teleop_drake import HuntCrossleyConfig, LoadRecording, simulate
from teleop_drake.loops.kernel import FixedBlock, Kernel, Transition
from teleop_drake.loops.run.recording import Recording
from teleop_drake.model.channels.network import NetworkChannelConfig

ENGINES = pytest.mark.parametrize("engine", ["compiled", "drake"])


def side(mode, x):
    """Reaches 0 where x reaches 0.5 on the way up, and -0.5 on the way down."""
    return np.where(mode > 0, -x - 0.5, x - 0.5)


def flip(mode):
    return 1 - mode


def speed(mode):
    return np.where(mode > 0, -1.0, 1.0)


def MakeRelay():
    """x' = 1 up to x = 0.5, x' = -1 down to x = -0.5, and so on; one level deep."""
    relay = FixedBlock(
        "relay",
        Kernel(
            outputs={"u": (speed, "mode")},
            transitions={
                "switches": Transition(guard=(side, "mode", "x"), mode=(flip, "mode"))
            },
        ),
        inputs={"x": 1},
        outputs={"u": 1},
        mode=(0.0,),
    )
    inner = Wired({"relay": relay}, {}, {"u": "relay"}, inputs={"x": "relay"})
    return Wired(
        {"law": inner, "plant": Integrator(1)}, {"plant": "law", "law": "plant"}
    )


@ENGINES
def test_guards_are_events_by_the_names_of_their_transitions(engine):
    """What is due at the end does not happen."""
    recording = simulate(MakeRelay(), duration=2.5, engine=engine)
    assert {event.name for event in recording.events} == {"law/relay.switches"}
    times = recording.EventTimes("law/relay.switches")
    assert_allclose(times, [0.5, 1.5], atol=1e-6)


@ENGINES
def test_a_wall_that_is_touched_is_an_event(engine):
    """Its position is no recorded signal."""
    wall = HuntCrossleyConfig(start=0.1, stiffness=1e4, direction=[1.0])
    rates = np.array([[0.0, 1.0], [0.0, 0.0]])
    mass = LinearSystem(rates, [[0.0], [-1.0]], np.eye(2), np.zeros((2, 1)))
    diagram = Wired(
        {
            "mass": mass,
            "split": Demultiplexer(2),
            "wall": wall.MakeEnvironment(np.zeros(1)),
        },
        {
            "split": "mass",
            "wall.tool_position": "split.y0",
            "wall.tool_velocity": "split.y1",
            "mass": "wall",
        },
        {"state": "mass"},
    )
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([0.0, 0.5])
    recording = simulate(diagram, context=context, duration=1.0, engine=engine)
    assert list(recording) == ["state"]
    assert [event.name for event in recording.events] == ["wall.contact"]
    assert recording.events[0].time == pytest.approx(0.2, abs=1e-7)
    # It bounces back.
    assert recording["state"][-1, 0] < 0


def test_the_run_of_a_system_is_saved(tmp_path):
    """With its events, and the packets of a network in it."""
    config = NetworkChannelConfig(delay=0.1, sample_period=0.01)
    network = config.MakeChannel(size=1, initial_value=[0.0], duration=1.0)
    diagram = Wired(
        {"loop": MakeRelay(), "network": network, "source": Integrator(1)},
        {"network": "source"},
        inputs={"rate": "source"},
    )
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, [1.0])
    recording = simulate(diagram, context=context, duration=1.0)
    path = tmp_path / "run.npz"
    recording.Save(path)
    loaded = LoadRecording(path)
    assert type(loaded) is Recording
    assert loaded.EventTimes("loop/law/relay.switches") == pytest.approx([0.5])
    for name in ("events", "solver", "channels", "termination", "notes"):
        assert getattr(loaded, name) == getattr(recording, name)
    assert list(loaded.channels) == ["network"]
    for name, samples in recording.signals.items():
        assert_array_equal(loaded[name], samples)
        middle = recording.Interpolate(name, [0.123])
        assert_array_equal(loaded.Interpolate(name, [0.123]), middle)
    with pytest.raises(AttributeError, match="no attribute 'scenario'"):
        loaded.scenario  # noqa: B018
