"""Odd scenarios that are accepted: each run completes, diverges or is interrupted."""

import json
import math
import signal

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from teleop_drake.loops.run import drake_run
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import (
    ARCHITECTURES,
    LoadScenario,
    ScenarioError,
    ScenarioNames,
)
from teleop_drake.model.tasks.metrics import RunSummary

# A run is interrupted after so many reports of progress: a stiff loop may take days.
PATIENCE = 40

magnitudes = st.floats(-3, 9).map(lambda exponent: float(f"{10**exponent:.3g}"))
TELEOPERATION = {
    "controller.kind": st.sampled_from(ARCHITECTURES),
    "controller.G1": magnitudes,
    "controller.G2": magnitudes,
    "controller.adaptation_rate": magnitudes,
    "controller.leakage": magnitudes,
    "controller.robust.force_rate_bound": magnitudes,
    "controller.robust.acceleration_bound": magnitudes,
    "actuator.bandwidth": magnitudes,
    "actuator.coulomb_friction": magnitudes,
    "sensor.encoder": st.just({"sample_period": 0.003, "resolution": 1e-5}),
    "sensor.force": st.just({"sample_period": 0.004, "noise": 1e-3}),
    "surgeon.velocity.0": magnitudes | magnitudes.map(lambda v: -v),
    "surgeon.stop_time": st.floats(0, 0.05),
    "haptic_device.numerator": st.lists(magnitudes, min_size=1, max_size=2),
    "forward_channel.delay": st.sampled_from([0, 0.005, 0.02]),
    "return_channel": st.sampled_from(
        [
            {"kind": "sampled", "delay": 0.01, "sample_period": 0.004},
            {"kind": "network", "delay": 0.01, "sample_period": 0.004},
            {"kind": "variable", "delay": 0.01},
        ]
    ),
    "environment.layers.0.stiffness": magnitudes,
    "environment.layers.0.damping": magnitudes,
    "environment.layers.0.reference": magnitudes.map(lambda x: x * 1e-3),
}
TRACKING = {
    "controller.Lambda": magnitudes,
    "controller.G1": magnitudes,
    "controller.adaptation_rate": magnitudes,
    "disturbance.gain": magnitudes,
    "trajectory.frequency": magnitudes,
}
SOLVER = {
    "simulator.use_error_control": st.booleans(),
    "simulator.max_step_size": st.sampled_from([0.002, 0.005]),
    "simulator.accuracy": st.sampled_from([1e-3, 1e-8]),
}


@st.composite
def odd_scenarios(draw):
    """Returns the name of a scenario and its overrides."""
    name = draw(st.sampled_from(ScenarioNames()))
    fields = TRACKING if name.startswith("network_tracking") else TELEOPERATION
    paths = draw(
        st.lists(st.sampled_from(sorted(fields)), min_size=1, max_size=4, unique=True)
    )
    pairs = {path: draw(fields[path]) for path in paths}
    return name, pairs | {path: draw(SOLVER[path]) for path in SOLVER}


def numbers(tree):
    """Yields the numbers of a tree."""
    if isinstance(tree, dict | list):
        for item in tree.values() if isinstance(tree, dict) else tree:
            yield from numbers(item)
    elif isinstance(tree, float):
        yield tree


OVERFLOWS = {
    "disturbance.gain": 6.11e8,
    "simulator.use_error_control": False,
    "simulator.max_step_size": 0.002,
}


@pytest.mark.slow
@given(odd_scenarios())
@example(("network_tracking_coupled", OVERFLOWS))
@settings(max_examples=3)
def test_accepted_scenarios_complete_or_diverge(case):
    check(*case)


@pytest.mark.slow
@given(odd_scenarios())
@settings(max_examples=25)
def test_many_accepted_scenarios_complete_or_diverge(case):
    check(*case)


def check(name, pairs):
    """Simulates a scenario, if it is accepted, and checks how the run ends."""
    num_steps = 0

    def lose_patience(simulated_time):
        nonlocal num_steps
        num_steps += 1
        if num_steps == PATIENCE:
            signal.raise_signal(signal.SIGINT)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drake_run, "_REPORT_PERIOD", 0.0)
        try:
            scenario = LoadScenario(name, pairs | {"duration": 0.03})
            recording = simulate(scenario, progress=lose_patience, engine="drake")
        except ScenarioError:
            return
    assert recording.termination in ("completed", "diverged", "interrupted")
    assert (recording.termination == "completed") == (recording.reason == "")
    if recording.termination == "completed":
        assert recording.time[-1] == scenario.duration
    for values in recording.signals.values():
        assert np.isfinite(values).all()
    summary = RunSummary(recording)
    assert all(math.isfinite(number) for number in numbers(summary))
    json.dumps(summary, allow_nan=False)
