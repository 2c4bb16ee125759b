"""The runs behind the figures and the claims, each simulated once."""

import functools
import json
import math
import shlex
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks.metrics import RunMetrics

Change = Mapping[str, Any]
"""Overrides of a scenario: values keyed by dotted path."""

DIRECT = {"controller.kind": "direct_force"}
ADAPTIVE = {"controller.kind": "adaptive_backstepping"}
TASKS = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")
NETWORKS = ("network_tracking_linear", "network_tracking_coupled")
LEARNING = "two_dof_learning"
"""The scenario whose settings make the networks learn."""

NO_ADAPTATION = {"controller.adaptation_rate": 0.0}


def Delay(seconds: float) -> Change:
    """Returns the change that sets the delay of both channels, in s."""
    return {"forward_channel.delay": seconds, "return_channel.delay": seconds}


SHORT: dict[str, Change] = {
    name: {
        "duration": duration,
        "simulator.max_step_size": 0.1,
        "simulator.accuracy": 1e-9 if name == "one_dof" else 1e-7,
    }
    for name, duration in zip(TASKS, (18.0, 6.0, 5.0, 5.0), strict=True)
}
"""Settings of each task with which every metric agrees with its full run to 0.1 %."""


_INSIDE_WORKSPACE = 1.4
"""The x in m at which runs of case I are cut; the arm reaches 1.5 m at most."""


class Run:
    """A run and its metrics."""

    def __init__(self, recording: TaskRecording):
        self.recording = recording

    @functools.cached_property
    def metrics(self) -> Record:
        """The metrics of the run; see RunMetrics()."""
        return RunMetrics(self.recording)

    @functools.cached_property
    def inside(self) -> "Run":
        """The part of the run before the arm is nearly stretched; used for case I."""
        is_outside = self.recording["tool_position"][:, 0] >= _INSIDE_WORKSPACE
        end = self.recording.time[is_outside].min(initial=math.inf)
        return Run(self.recording.Part(0.0, float(end)))

    def __getitem__(self, path: str) -> Any:
        """Returns a metric by its dotted name; None if the run lacks it."""
        value: Any = self.metrics
        for part in path.split("."):
            value = None if value is None else value[part]
        return value

    def Number(self, path: str) -> float:
        """Returns a metric as a number, NaN if the run lacks it."""
        value = self[path]
        return math.nan if value is None else float(value)


class Both(NamedTuple):
    """The runs of one task with direct force and with the adaptive controller."""

    direct: Run
    adaptive: Run

    def Numbers(self, path: str) -> tuple[float, float]:
        """Returns a metric of both runs; see Run.Number()."""
        return self.direct.Number(path), self.adaptive.Number(path)


class ThesisRuns:
    """A store of runs, each of which is simulated at the first request.

    Attributes:
        used: The commands of the runs requested since it was last cleared, in order.

    Args:
        progress: Called with one line of text when a run is finished.
    """

    def __init__(self, progress: Callable[[str], None] = lambda line: None):
        self._progress = progress
        self._runs: dict[str, Run] = {}
        self.used: dict[str, None] = {}

    def __call__(self, name: str, *changes: Change) -> Run:
        """Returns a run, which is simulated unless it is in the store.

        Args:
            name: A built-in scenario or a YAML file.
            changes: Overrides of the scenario; later ones take precedence.

        Raises:
            ScenarioError: If the scenario is not valid.
            KeyboardInterrupt: If the run was interrupted.
        """
        overrides = {path: x for change in changes for path, x in change.items()}
        words = ["teleop-drake", "run", name]
        for path, x in overrides.items():
            words += ["--set", f"{path}={x if isinstance(x, str) else json.dumps(x)}"]
        command = shlex.join(words)
        if command not in self._runs:
            recording = simulate(LoadScenario(name, overrides))
            if recording.termination == "interrupted":
                raise KeyboardInterrupt
            self._runs[command] = Run(recording)
            seconds = recording.solver.wall_time_s
            self._progress(f"{command}: {recording.termination}, {seconds:.1f} s")
        self.used[command] = None
        return self._runs[command]

    def Short(self, name: str, *changes: Change) -> Run:
        """Returns a run of a task with the settings of SHORT."""
        return self(name, SHORT[name], *changes)

    def OfBoth(self, name: str) -> Both:
        """Returns the runs of a task with both controllers."""
        return Both(self(name, DIRECT), self(name, ADAPTIVE))

    def ShortOfBoth(self, name: str, change: Change) -> Both:
        """Returns short runs of a task with both controllers."""
        return Both(*(self.Short(name, x, change) for x in (DIRECT, ADAPTIVE)))
