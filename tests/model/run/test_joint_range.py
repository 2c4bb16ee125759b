"""A run ends where a joint leaves its range."""

import numpy as np
import pytest

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunMetrics

# The operator pulls the needle back until the wrist cannot bend any further.
BACK = {
    "controller.kind": "direct_force",
    "surgeon.velocity": [-0.1, 0.0, 0.0],
    "duration": 2.5,
}


@pytest.mark.parametrize(
    "engine", ["compiled", pytest.param("drake", marks=pytest.mark.slow)]
)
def test_it_ends_at_the_limit(engine):
    recording = simulate(LoadScenario("puma560_insertion", BACK), engine=engine)
    assert recording.termination == "diverged"
    assert recording.reason == "joint wrist_bend leaves its range, -1.745 to 1.745"
    assert recording["joint_position"][-1, 4] == pytest.approx(
        np.radians(100), abs=1e-6
    )
    assert recording.time[-1] == pytest.approx(1.0, abs=1)
    assert RunMetrics(recording)["diverged_at"] == recording.time[-1]
