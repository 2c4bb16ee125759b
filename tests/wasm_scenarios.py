"""A scenario's page run by wasmtime, compared with the native run."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from wasm_runs import Instance

from teleop_drake.loops.numerics.step_polynomials import interpolate, part
from teleop_drake.loops.run.recording import Recording
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.tasks.metrics import RunMetrics
from teleop_drake.study.page.scenario_model import ModelOf
from teleop_drake.study.sweep import FlattenMetrics


def AssertSame(scenario, model=None, instants=1e-9):
    """Compares jumps, metrics, and signals between the rows of both runs."""
    model = model or ModelOf(scenario)
    native = simulate(scenario, engine="compiled")
    instance = Instance(model)
    # At a bound the page's script ends a run; see test_page.py. The native run is cut
    # within a step, so the module takes the same step, and is cut there.
    end = native.time[-1]
    instance.Run(*model.numbers["run"], enough=end)
    times, signals, steps = instance.Rows()
    times, signals, steps = part((times, {"rows": signals}, steps), 0.0, end)
    rows = signals["rows"]
    assert times[-1] == pytest.approx(native.time[-1], rel=0, abs=instants)
    jumps, native_jumps = (t[1:][np.diff(t) == 0] for t in (times, native.time))
    assert jumps == pytest.approx(native_jumps, rel=0, abs=instants)
    ports = model.Ports()
    looked = np.linspace(0.0, times[-1], 400)
    signals = {}
    for name, port in model.Signals().items():
        begin, size, _ = ports[port]
        signals[name] = rows[:, begin : begin + size]
        signal = interpolate(times, signals[name], steps, looked)
        reference = native.Interpolate(name, looked)
        error = np.abs(signal - reference).max(initial=0.0)
        assert error <= 1e-6 * max(np.ptp(native[name]), 1e-9), name
    run = dataclasses.replace(native, time=times, steps=steps, signals=signals)
    AssertSameMetrics(FlattenMetrics(RunMetrics(run)), native, 1e-6)
    return native


def AssertSameMetrics(found: dict[str, Any], native: Recording, accuracy: float):
    """Compares metrics with those of a recording; what is None may be left out.

    How a run ended is not among the metrics of a page.
    """
    metrics = FlattenMetrics(RunMetrics(native))
    expected = {name: x for name, x in metrics.items() if x is not None}
    ends = {"diverged", "diverged_at"}
    known = {name: x for name, x in found.items() if x is not None}
    assert known.keys() - ends == expected.keys() - ends
    for name in known.keys() - ends:
        value = pytest.approx(expected[name], rel=accuracy, abs=1e-12)
        assert known[name] == value, (name, known[name], expected[name])
