"""Sweeps: a scenario over a grid of its fields, in many processes, and resumable."""

import contextlib
import itertools
import json
import os
import time as clock
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from teleop_drake.recording import Recording
from teleop_drake.scenario import ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.simulation.compiled_run import WhyNotCompiled
from teleop_drake.sweep.folder import SweepFolder
from teleop_drake.sweep.plan import PlanSweep, PointOverrides, Source, SweepPlan
from teleop_drake.sweep.result import SweepError, SweepResult
from teleop_drake.sweep.workers import CALLS_PER_PROCESS, WorkerProcesses
from teleop_drake.tasks.metrics import RunSummary

# So many runs wait in the executor: enough for a large cluster.
_MAX_IN_FLIGHT = 1000

# Compiled runs that would take no longer than this, in s, than worker processes take to
# start and import, are done without. They are no more than a worker does before it is
# recycled, because a run may leave memory behind.
_START_OF_WORKERS = 6.0
_MAX_HERE = CALLS_PER_PROCESS


def Sweep(
    scenario: str | os.PathLike[str],
    grid: Mapping[str, Iterable[Any]],
    *,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    engine: str = "auto",
    executor: Executor | None = None,
    jobs: int | None = None,
    out: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
    notice: Callable[[str], None] | None = None,
) -> SweepResult:
    """Simulates a scenario for each combination of values.

        Sweep("one_dof", {"controller": CONTROLLERS, "delay": np.linspace(0, 0.4, 9)})

    A run that fails is a record with its reason, and so is a combination of values
    that is not valid; the sweep goes on. If the executor loses a run, by the death of
    a process perhaps, the run is tried once more.

    In a script, call this under `if __name__ == "__main__":`, because Python imports
    the script in each worker process. A notebook need not.

    Args:
        scenario: A built-in name or a YAML file.
        grid: Values by key. A key is the dotted path of a field as LoadScenario takes
            it, or one of ALIASES. The last key varies fastest.
        overrides: For all runs, as LoadScenario takes them.
        engine: As simulate() takes it; `auto` runs what can be compiled as machine
            code, and says of what cannot why.
        executor: Where to simulate: any Executor whose workers can import this
            package, for example `distributed.Client(...).get_executor()`. It stays
            open. None makes WorkerProcesses.
        jobs: Number of WorkerProcesses, >= 1; None: as many as there are processors,
            and none for compiled runs that would be done before these have started.
        out: Folder to write to; None writes nothing.
        resume: Whether to go on with the sweep in `out`, if there is one. To have a
            run done again, delete its line in runs.jsonl.
        progress: Called with the number of runs that are finished and the number of
            all, at the start and after each.
        notice: Called with a line of text if runs cannot be machine code, or if runs in
            `out` have to be done again because their lines were changed; None:
            warnings.warn.

    Returns:
        The records of all runs.

    Raises:
        ScenarioError: If a value of the grid is not valid with any of the others.
        SweepError: If the grid, jobs or the folder cannot be used.
        RuntimeError: If the executor gives up. What is finished stays in `out`.
        OSError: If a file cannot be written.
    """
    plan = PlanSweep(scenario, grid, overrides=overrides, engine=engine)
    return RunSweep(
        plan,
        executor=executor,
        jobs=jobs,
        out=out,
        resume=resume,
        progress=progress,
        notice=notice,
    )


def RunSweep(
    plan: SweepPlan,
    *,
    executor: Executor | None = None,
    jobs: int | None = None,
    out: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
    notice: Callable[[str], None] | None = None,
) -> SweepResult:
    """Does what a plan says; arguments and errors are those of Sweep()."""
    _CheckJobs(jobs, executor)
    with contextlib.ExitStack() as stack:
        folder = None
        if out is not None:
            folder = stack.enter_context(
                SweepFolder(Path(out), plan, resume, notice or warnings.warn)
            )
        records = _RunAll(
            plan, range(len(plan.points)), folder, executor, jobs, progress, notice
        )
        result = SweepResult(scenario=plan.scenario, axes=plan.axes, records=records)
        if folder is not None:
            folder.Finish(result)
    return result


def RunPart(
    plan: SweepPlan,
    part: tuple[int, int],
    out: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    jobs: int | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
    notice: Callable[[str], None] | None = None,
) -> list[dict[str, Any]]:
    """Does every N-th run of a plan, and returns their records.

    Part (I, N) has the runs I - 1, I - 1 + N and so on. MergeParts makes a sweep of all
    parts, which may be done on different machines. The other arguments and the errors
    are those of Sweep().
    """
    _CheckJobs(jobs, executor)
    number, count = part
    if not 1 <= number <= count:
        raise SweepError(f"part = {number}/{count}: must be 1/N to N/N")
    runs = range(number - 1, len(plan.points), count)
    with SweepFolder(Path(out), plan, resume, notice or warnings.warn, part) as folder:
        records = _RunAll(plan, runs, folder, executor, jobs, progress, notice)
        folder.FinishPart(records)
    return records


def MergeParts(
    plan: SweepPlan,
    parts: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    notice: Callable[[str], None] | None = None,
) -> SweepResult:
    """Makes one sweep of parts that RunPart has done.

    Args:
        parts: Their folders, in the order of the parts: all there are.
        out: Folder of the sweep; one that was merged before is written anew.
        notice: Called with what the user should know of the folders.

    Returns:
        The records of all runs.

    Raises:
        SweepError: If a folder cannot be used, is of another sweep, or lacks runs.
        OSError: If a file cannot be written.
    """
    notice = notice or warnings.warn
    records: dict[int, dict[str, Any]] = {}
    for i, path in enumerate(parts):
        part = (i + 1, len(parts))
        with SweepFolder(Path(path), plan, True, notice, part) as folder:
            records |= folder.records
    missing = len(plan.points) - len(records)
    if missing:
        raise SweepError(
            f"parts = {len(parts)} folders: must have all {len(plan.points)} runs, and "
            f"{missing} are missing; --resume does them"
        )
    result = SweepResult(
        scenario=plan.scenario,
        axes=plan.axes,
        records=[records[run] for run in range(len(plan.points))],
    )
    with SweepFolder(Path(out), plan, True, notice) as folder:
        folder.Finish(result)
    return result


def _CheckJobs(jobs: int | None, executor: Executor | None) -> None:
    if jobs is not None and (jobs < 1 or executor is not None):
        allowed = "1 or more" if jobs < 1 else "None where an executor is given"
        raise SweepError(f"jobs = {jobs}: must be {allowed}")


def _RunAll(
    plan: SweepPlan,
    runs: Sequence[int],
    folder: SweepFolder | None,
    executor: Executor | None,
    jobs: int | None,
    progress: Callable[[int, int], None] | None,
    notice: Callable[[str], None] | None,
) -> list[dict[str, Any]]:
    """Returns the records of runs of a plan; does what the folder does not have."""
    records = {} if folder is None else dict(folder.records)
    if progress is not None:
        progress(len(records), len(runs))
    missing = [run for run in runs if run not in records]
    is_compiled = bool(missing) and plan.engine != "drake"
    if is_compiled:
        why = WhyNotCompiled(plan.scenario)
        if why:
            (notice or warnings.warn)(f"Run in Drake's Simulator: {why}.")
            is_compiled = False

    def Take(record: dict[str, Any]) -> None:
        records[record["run"]] = record
        if folder is not None:
            folder.Append(record)
        if progress is not None:
            progress(len(records), len(runs))

    with contextlib.ExitStack() as stack:
        if is_compiled and executor is None and jobs is None:
            for record in _SimulateHere(plan, missing):
                Take(record)
            missing = [run for run in runs if run not in records]
        if missing and executor is None:
            executor = WorkerProcesses(min(jobs or os.cpu_count() or 1, len(missing)))
            stack.callback(executor.shutdown, cancel_futures=True)
        if executor is not None:
            for record in _Simulate(plan, missing, executor):
                Take(record)
    return [records[run] for run in runs]


def _SimulateHere(plan: SweepPlan, runs: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Simulates runs of a plan in this process, until worker processes would pay."""
    times: list[float] = []
    for i, run in enumerate(runs[:_MAX_HERE]):
        # The first run may compile.
        if sum(times[1:]) * (len(runs) - i) > _START_OF_WORKERS * max(i - 1, 0) > 0:
            return
        start = clock.process_time()
        record = _SimulateOne(plan.source, _Overrides(plan, run), "auto")
        times.append(clock.process_time() - start)
        yield {"run": run, "varied": plan.points[run], **record}


def _Overrides(plan: SweepPlan, run: int) -> list[str]:
    return [*plan.overrides, *PointOverrides(plan.points[run])]


def _Simulate(
    plan: SweepPlan, runs: Iterable[int], executor: Executor
) -> Iterator[dict[str, Any]]:
    """Simulates runs of a plan and yields each record as it comes."""
    finished: SimpleQueue[tuple[int, Future[dict[str, Any]]]] = SimpleQueue()
    pending: dict[int, Future[dict[str, Any]]] = {}
    retried: set[int] = set()

    def Submit(run: int) -> None:
        # Why it is not machine code was said once for all.
        engine = "drake" if plan.engine == "drake" else "auto"
        overrides = _Overrides(plan, run)
        future = executor.submit(_SimulateOne, plan.source, overrides, engine)
        pending[run] = future
        future.add_done_callback(lambda future: finished.put((run, future)))

    waiting = iter(runs)
    try:
        for run in itertools.islice(waiting, _MAX_IN_FLIGHT):
            Submit(run)
        while pending:
            run, future = finished.get()
            del pending[run]
            error = None if future.cancelled() else future.exception()
            if future.cancelled() or isinstance(error, BrokenExecutor):
                raise RuntimeError(
                    f"the executor gave up: {_OneLine(error or 'it cancelled a run')}"
                ) from error
            if error is None:
                outcome = future.result()
            elif not isinstance(error, Exception):
                raise error  # KeyboardInterrupt.
            elif run not in retried:
                retried.add(run)
                Submit(run)
                continue
            else:
                outcome = _Failure(error)
            yield {"run": run, "varied": plan.points[run], **outcome}
            for run in itertools.islice(waiting, 1):
                Submit(run)
    finally:
        for future in pending.values():
            future.cancel()


def _SimulateOne(source: Source, overrides: list[str], engine: str) -> dict[str, Any]:
    """Simulates one run, in a worker, and returns its record."""
    try:
        return _Outcome(simulate(source.Load(overrides), engine=engine))
    except (Exception, SystemExit) as error:
        # Some violated contracts of Drake end in SystemExit.
        return _Failure(error)


def _Outcome(recording: Recording) -> dict[str, Any]:
    """Returns the record of a run but for its place in the grid."""
    if recording.termination == "interrupted":
        raise KeyboardInterrupt
    record = {
        "status": recording.termination,
        "reason": recording.reason,
        **RunSummary(recording),
    }
    del record["solver"]["wall_time_s"], record["solver"]["real_time_factor"]
    json.dumps(record, allow_nan=False)
    return record


def _Failure(error: BaseException) -> dict[str, Any]:
    return {"status": "failed", "reason": _OneLine(error), "metrics": None}


def _OneLine(error: BaseException | str) -> str:
    # A note names the block that raised it.
    notes = getattr(error, "__notes__", [])
    text = " ".join(" ".join([str(error), *notes]).split())
    if isinstance(error, str | ScenarioError | RuntimeError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
