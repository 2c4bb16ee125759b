"""The plan of a sweep: what is simulated at each point of a grid."""

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.loops.run.recording import Recording
from teleop_drake.study.sweep.result import SweepResult
from teleop_drake.study.sweep.values import Grid, Point

Programs = dict[Any, Any]
"""The compiled programs of a sweep, which its runs share."""

# A value of the grid is accepted if it is valid in combination with other values. At
# most so many combinations are tried.
_MAX_CHECKS = 61

_T = TypeVar("_T")

R = TypeVar("R", bound=SweepResult)
"""The class of the result of a sweep."""


@dataclass(kw_only=True)
class AnyPlan(ABC, Generic[R]):
    """A checked sweep: a SweepPlan of a scenario, or a SystemPlan of a System.

    Attributes:
        axes: Keys of the grid and their values.
        points: A dict from key to value for each run; the last key varies fastest.
        engine: The engine, as in simulate().
    """

    axes: Grid
    points: list[Record]
    engine: str

    @property
    def stays_here(self) -> bool:
        """Whether the sweep has an object that cannot be sent to another process."""
        return False

    @abstractmethod
    def Parameters(self) -> Record:
        """Returns what the records depend on besides axes and engine, for JSON."""

    @abstractmethod
    def WhyNotCompiled(self) -> str:
        """Returns why the runs cannot be compiled; empty if they can."""

    @abstractmethod
    def Simulate(self, point: Point, programs: Programs) -> Recording:
        """Simulates the run at a point, with a program of an earlier run if one fits.

        Args:
            programs: The programs so far, to which a new program is added.

        Raises:
            ScenarioError: If the run is not valid.
        """

    @abstractmethod
    def Summary(self, recording: Any) -> Record:
        """Returns the metrics and all else that a record has of a run, for JSON."""

    @abstractmethod
    def Result(self, records: list[Record]) -> R:
        """Returns the result of the sweep from the records of all its runs."""

    def Outcome(self, point: Point, programs: Programs) -> Record:
        """Simulates the run at a point; returns its record without run and varied."""
        recording = self.Simulate(point, programs)
        if recording.termination == "interrupted":
            raise KeyboardInterrupt
        solver = dataclasses.asdict(recording.solver)
        del solver["wall_time_s"], solver["real_time_factor"]
        return {
            "status": recording.termination,
            "reason": recording.reason,
            **self.Summary(recording),
            "solver": solver,
        }


def CheckValues(load: Callable[[Point], _T], axes: Grid, points: Sequence[Point]) -> _T:
    """Refuses values that are valid in no combination; loads a valid point.

    Args:
        load: Returns what is simulated at a point, or refuses its values.
        points: All points of the grid; the last axis varies fastest.

    Raises:
        ScenarioError: The error of the first point with a value that is never valid.
    """
    runs = np.arange(len(points)).reshape([len(values) for values in axes.values()])
    first: _T | None = None
    for axis, num_values in enumerate(runs.shape):
        for i in range(num_values):
            own = runs.take(i, axis).ravel()
            own = own[:: max(len(own) // _MAX_CHECKS, 1)]
            loaded = _FirstValid(load, [points[run] for run in own.tolist()])
            first = first or loaded
    return first or load({})


def _FirstValid(load: Callable[[Point], _T], points: Iterable[Point]) -> _T:
    """Loads the first valid point, or raises the first error."""
    errors: list[ScenarioError] = []
    for point in points:
        try:
            return load(point)
        except ScenarioError as error:
            errors.append(error)
    raise errors[0]
