"""The simulations behind the figures and the ledger, each done once."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from types import TracebackType
from typing import Any, Self

from teleop_drake.recording import Recording
from teleop_drake.scenario import AnyScenario, LoadScenario, ScenarioToYaml
from teleop_drake.simulation import simulate
from teleop_drake.sweep.workers import WorkerProcesses
from teleop_drake.validation import CheckNumber

_Overrides = Mapping[str, Any]
_Parts = dict[str, Any]


class ThesisRuns:
    """Simulates scenarios in worker processes and keeps what comes out.

    Two requests are one run if their resolved scenarios are equal, however they are
    written. Calling from several threads is not supported.

        with ThesisRuns() as runs:
            runs.Prefetch([("one_dof", {"controller.kind": "direct_force"})])
            recording = runs("one_dof", **{"controller.kind": "direct_force"})

    A script that uses more than one process must keep its own work under
    `if __name__ == "__main__":`, because Python imports it in each of them.

    Args:
        jobs: Number of worker processes, >= 1; 1 simulates in this process, on demand.
        progress: Called with one line of text when a run is finished, possibly from
            another thread.
        engine: As simulate() takes it.

    Raises:
        ValueError: If jobs is less than 1.
    """

    def __init__(
        self,
        jobs: int = 2,
        progress: Callable[[str], None] | None = None,
        *,
        engine: str = "auto",
    ):
        CheckNumber("jobs", jobs, minimum=1)
        self._engine = engine
        self._progress = progress
        self._executor = WorkerProcesses(jobs) if jobs > 1 else None
        self._requests: dict[tuple[str, str], tuple[str, AnyScenario]] = {}
        self._futures: dict[str, Future[_Parts]] = {}
        self._recordings: dict[str, Recording] = {}

    def __enter__(self) -> Self:
        """Returns this object."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Ends the worker processes, see Close."""
        self.Close()

    @property
    def num_simulated(self) -> int:
        """Number of runs that were handed out so far, each simulated once."""
        return len(self._recordings)

    def __call__(self, name: str, /, **overrides: Any) -> Recording:
        """Returns a run, simulated now unless it is there already or under way.

        Args:
            name: A built-in scenario or a YAML file.
            overrides: Values by dotted path, so usually `**{"path": value}`.

        Raises:
            ScenarioError: If the scenario is not valid.
            RuntimeError: If the simulation fails, which says in which run and why.
            KeyboardInterrupt: If the run was interrupted.
        """
        key, scenario = self._Resolve(name, overrides)
        if key not in self._recordings:
            self._Start(key, name, overrides)
            try:
                if self._executor is None:
                    recording = simulate(scenario, engine=self._engine)
                    self._Report(name, overrides, recording)
                else:
                    parts = self._futures.pop(key).result()
                    recording = Recording(scenario=scenario, **parts)
            except Exception as error:
                raise RuntimeError(
                    f"the run {_Title(name, overrides)} failed: {error}"
                ) from error
            if recording.termination == "interrupted":
                raise KeyboardInterrupt
            self._recordings[key] = recording
        return self._recordings[key]

    def Prefetch(self, requests: Iterable[tuple[str, _Overrides]]) -> None:
        """Starts runs that will be asked for, in this order.

        With one job there is nothing to gain: each is simulated when it is asked for.

        Args:
            requests: Names and overrides as __call__ takes them.

        Raises:
            ScenarioError: If a scenario is not valid.
        """
        for name, overrides in requests:
            key, _ = self._Resolve(name, overrides)
            if key not in self._recordings:
                self._Start(key, name, overrides)

    def Close(self) -> None:
        """Ends the worker processes, and with them the runs that nobody waits for."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)

    def _Resolve(self, name: str, overrides: _Overrides) -> tuple[str, AnyScenario]:
        request = (name, repr(sorted(overrides.items())))
        if request not in self._requests:
            scenario = LoadScenario(name, overrides)
            self._requests[request] = (ScenarioToYaml(scenario), scenario)
        return self._requests[request]

    def _Start(self, key: str, name: str, overrides: _Overrides) -> None:
        if self._executor is None or key in self._futures:
            return
        future = self._executor.submit(
            _SimulateForTransport, name, dict(overrides), self._engine
        )
        self._futures[key] = future
        _, scenario = self._Resolve(name, overrides)

        def Report(done: Future[_Parts]) -> None:
            if not done.cancelled() and done.exception() is None:
                recording = Recording(scenario=scenario, **done.result())
                self._Report(name, overrides, recording)

        future.add_done_callback(Report)

    def _Report(self, name: str, overrides: _Overrides, recording: Recording) -> None:
        if self._progress is not None:
            self._progress(
                f"{_Title(name, overrides)}: {recording.termination}, "
                f"{recording.solver.wall_time_s:.1f} s"
            )


def _Title(name: str, overrides: _Overrides) -> str:
    return ", ".join([name, *(f"{path}={x}" for path, x in overrides.items())])


def _SimulateForTransport(name: str, overrides: _Overrides, engine: str) -> _Parts:
    """Returns the fields of a recording but its scenario, which does not pickle."""
    parts = vars(simulate(LoadScenario(name, overrides), engine=engine)).copy()
    del parts["scenario"]
    return parts
