"""Both engines record signals to 1e-4 of their range between their steps."""

import numpy as np
import pytest
from grids import Slow

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario

# Jumps are located to better than this, s.
LOCATED = 1e-5


@pytest.mark.parametrize(
    ("name", "engine", "overrides"),
    Slow(
        [
            ("one_dof", "compiled", {"duration": 16.0}),
            ("one_dof", "compiled", {"controller.kind": "direct_force"}),
            ("two_dof_combined", "compiled", {}),
            ("puma560_insertion", "compiled", {"duration": 4.5}),
            ("network_tracking_coupled", "drake", {"duration": 3.0}),
        ],
        but=[0],
    ),
)
def test_every_signal_halfway_is_that_of_much_smaller_steps(name, engine, overrides):
    recording = simulate(LoadScenario(name, overrides), engine=engine)
    fine = {"simulator.accuracy": 1e-12, "simulator.max_step_size": 2e-3}
    reference = simulate(LoadScenario(name, overrides | fine), engine="compiled")
    begin, end = (recording.time[recording.steps[:, k]] for k in (0, -1))
    times = np.concatenate([begin + k / 8 * (end - begin) for k in (1, 3, 5, 7)])
    for run in (recording, reference):
        jumps = run.time[1:][np.diff(run.time) == 0]
        distance = np.abs(times[:, np.newaxis] - jumps).min(axis=1, initial=np.inf)
        times = times[distance > LOCATED]
    assert len(times) > 3 * len(begin)
    for signal, rows in reference.signals.items():
        error = recording.Interpolate(signal, times) - reference.Interpolate(
            signal, times
        )
        # Drake's delay lines store the ends of steps only, not where a signal bends.
        is_late = engine == "drake" and signal.endswith("_received")
        share = 5e-4 if is_late else 1e-4
        assert np.all(np.abs(error) <= share * np.ptp(rows, axis=0) + 1e-12), signal
