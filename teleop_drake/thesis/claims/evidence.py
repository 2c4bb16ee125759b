"""Runs with their metrics, each computed once."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from teleop_drake.recording import Recording
from teleop_drake.tasks.metrics import RunMetrics
from teleop_drake.thesis.claims.requests import ADAPTIVE, DIRECT, Variant
from teleop_drake.thesis.runs import ThesisRuns


@dataclass(frozen=True)
class Run:
    """A run and its metrics."""

    recording: Recording
    metrics: dict[str, Any]

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
    """The same task with direct force and with the adaptive controller."""

    direct: Run
    adaptive: Run

    def Numbers(self, path: str) -> tuple[float, float]:
        """Returns a metric of both, see Run.Number."""
        return self.direct.Number(path), self.adaptive.Number(path)

    def IsBelow(self, path: str, factor: float = 1.0) -> bool:
        """Returns whether on each axis adaptive's is below factor times direct's."""
        return all(
            a < factor * d
            for a, d in zip(self.adaptive[path], self.direct[path], strict=True)
        )


class Evidence:
    """The runs with their metrics, each computed once."""

    def __init__(self, runs: ThesisRuns):
        self._runs = runs
        self._cache: dict[int, Run] = {}

    def __call__(
        self, name: str, kind: Mapping[str, Any] = {}, change: Mapping[str, Any] = {}
    ) -> Run:
        """Returns a run; the full one if nothing is changed, else a short one."""
        overrides = Variant(name, kind, change)[1] if change else dict(kind)
        recording = self._runs(name, **overrides)
        if id(recording) not in self._cache:
            # The recording is kept with its metrics, so that its id stays its own.
            self._cache[id(recording)] = Run(recording, RunMetrics(recording))
        return self._cache[id(recording)]

    def Both(self, name: str, change: Mapping[str, Any] = {}) -> Both:
        """Returns the runs of both controllers, see __call__."""
        return Both(
            direct=self(name, DIRECT, change), adaptive=self(name, ADAPTIVE, change)
        )
