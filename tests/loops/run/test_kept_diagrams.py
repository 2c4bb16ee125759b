"""The programs that simulate() keeps for Diagrams, against closed forms."""

import gc
import math

import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource, Gain, Integrator

from teleop_drake.loops import simulate
from teleop_drake.loops.run import compiled_run, kept_diagrams


def KeptLoop():
    """Returns x' = -k x with a Gain, and the system whose Context has x."""
    builder = DiagramBuilder()
    x = builder.AddNamedSystem("x", Integrator(1))
    gain = builder.AddNamedSystem("gain", Gain(-1.0, 1))
    source = builder.AddNamedSystem("source", ConstantVectorSource([0.0]))
    total = builder.AddNamedSystem("sum", Adder(2, 1))
    builder.Connect(x.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), total.get_input_port(0))
    builder.Connect(source.get_output_port(), total.get_input_port(1))
    builder.Connect(total.get_output_port(), x.get_input_port())
    return builder.Build()


def test_a_diagram_keeps_its_program_and_never_a_stale_number():
    """x' = c - x from x(0): x(1) = c + (x(0) - c)/e."""
    diagram = KeptLoop()
    source = diagram.GetSubsystemByName("source")
    for start, c, time in [(1, 0, 0), (1, 2, 0), (3, 2, 0), (3, 2, 5), (1, 0, 0)]:
        context = diagram.CreateDefaultContext()
        context.SetTime(time)
        context.SetContinuousState([start])
        own = source.GetMyMutableContextFromRoot(context)
        source.get_mutable_source_value(own).SetFromVector([c])
        for duration in (1.0, 1.0, 0.5):
            recording = simulate(diagram, context=context, duration=duration)
            expected = c + (start - c) * math.exp(-duration)
            assert recording["x.y0"][-1, 0] == pytest.approx(expected, abs=1e-7)
            assert recording.time[-1] == pytest.approx(time + duration)
            assert recording.final_context.get_time() == recording.time[-1]
    only = simulate(diagram, duration=0.1, signals=["gain.y0"])
    assert list(only.signals) == ["gain.y0"]
    gain = diagram.GetSubsystemByName("gain")
    gain.set_name("minus")
    assert "minus.y0" in simulate(diagram, duration=0.1).signals
    gain.DeclarePeriodicPublishEvent(0.1, 0.0, lambda context: None)
    notes = simulate(diagram, duration=0.1).notes
    assert any("does not know the event" in note for note in notes)


def test_a_kept_program_is_freed_with_its_diagram_and_taken_from_it(monkeypatch):
    diagram = KeptLoop()
    simulate(diagram, duration=0.1)
    assert diagram in kept_diagrams._KEPT
    monkeypatch.setattr(compiled_run, "Evaluator", None)  # It would make a new one.
    simulate(diagram, duration=0.1)
    gc.collect()
    known = len(kept_diagrams._KEPT)
    del diagram
    gc.collect()
    assert len(kept_diagrams._KEPT) == known - 1
