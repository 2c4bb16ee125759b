"""Sweeps: resumable runs of a scenario over a grid, on several processors."""

import contextlib
import json
import os
import pickle
import time as clock
import uuid
import warnings
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    as_completed,
)
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast, overload

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, System

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import (
    CheckKind,
    Refuse,
    RefuseGiven,
    ScenarioError,
)
from teleop_drake.study.sweep.any_plan import AnyPlan, Programs, R
from teleop_drake.study.sweep.folder import SweepFolder, Versions
from teleop_drake.study.sweep.programs import ProgramsOf
from teleop_drake.study.sweep.result import SweepError, SweepResult
from teleop_drake.study.sweep.values import (
    File,
    GivenGrid,
    Notice,
    Point,
    Progress,
)
from teleop_drake.study.sweep.workers import Workers

if TYPE_CHECKING:
    from teleop_drake.model.scenario.overrides import Overrides
    from teleop_drake.study.sweep.system_plan import Metrics, SystemMaker
    from teleop_drake.study.sweep.task_result import TaskSweepResult

# The time in s that worker processes take to start and import. Compiled runs that take
# no longer than this are simulated without workers.
_START_OF_WORKERS = 6.0

# This process itself simulates at most so many runs, because Drake leaks memory.
_MAX_RUNS_HERE = 100

# Calls of an executor on another machine are slow, so that a call has several compiled
# runs: at most _RUNS_PER_CALL, and fewer if there were less than _MIN_CALLS calls.
_RUNS_PER_CALL = 20
_MIN_CALLS = 16


@dataclass(frozen=True, kw_only=True)
class Execution:
    """Where runs are simulated and recorded, and how their progress is reported.

    Attributes:
        executor: Any Executor whose workers can import this package in the same
            version, for example `Client(...).get_executor(pure=False)` of Dask. It is
            not shut down. None: on this machine.
        jobs: Number of worker processes, >= 1. None: one for each processor, and none
            for compiled runs that would end before the processes have started.
        out: Folder to write to; None writes nothing.
        resume: Whether to continue what is in `out`, if there is something. To repeat
            a run, delete its line in runs.jsonl.
        progress: Called with the number of finished runs and the number of all runs, at
            the start and after each run.
        notice: Called with a line of text if runs cannot be compiled, or if a run in
            `out` has to be repeated.
    """

    executor: Executor | None = None
    jobs: int | None = None
    out: File | None = None
    resume: bool = False
    progress: Progress = lambda num_finished, num_runs: None
    notice: Notice = warnings.warn


HERE = Execution()
"""On this machine, with no files."""


@overload
def Sweep(
    scenario: File,
    grid: GivenGrid | None = None,
    *,
    overrides: "Overrides" = (),
    engine: str = "auto",
    executor: Executor | None = None,
    jobs: int | None = None,
    out: File | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    notice: Notice | None = None,
) -> "TaskSweepResult": ...


@overload
def Sweep(
    scenario: "System | SystemMaker",
    grid: GivenGrid | Sequence[Point] | None = None,
    *,
    metrics: "Metrics",
    duration: float,
    context: Context | None = None,
    simulator: SimulatorConfig | None = None,
    engine: str = "auto",
    executor: Executor | None = None,
    jobs: int | None = None,
    out: File | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    notice: Notice | None = None,
) -> SweepResult: ...


def Sweep(
    scenario: "File | System | SystemMaker",
    grid: GivenGrid | Sequence[Point] | None = None,
    *,
    metrics: "Metrics | None" = None,
    duration: float | None = None,
    context: Context | None = None,
    simulator: SimulatorConfig | None = None,
    overrides: "Overrides" = (),
    engine: str = "auto",
    executor: Executor | None = None,
    jobs: int | None = None,
    out: File | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    notice: Notice | None = None,
) -> SweepResult:
    """Simulates a scenario, or a System, for each combination of values.

        Sweep("one_dof", {"controller": CONTROLLERS, "delay": np.linspace(0, 0.4, 9)})
        Sweep(
            diagram,
            {"sensor.delay": [0.05, 0.1], "plant.Pole.mass": [1.0, 2.0]},
            duration=5.0,
            metrics={"largest angle": lambda run: abs(run["plant.state"][:, 1]).max()},
        )

    A run that fails, or a combination of values that is not valid, gets a record with
    the reason, and the sweep continues. A run whose process dies is repeated once. The
    records do not depend on where, or in which order, the runs are simulated.

    The runs of a System share one program, in threads of this process. Other processes
    need a function that makes the System, because a System cannot be sent to them.

    In a script, call this under `if __name__ == "__main__":`, because Python imports
    the script in each worker process. A notebook does not need this.

    Args:
        scenario: A built-in name or a YAML file; or a System, or a function that
            returns a System or (system, context).
        grid: Values by key; the last key varies fastest. A key is the dotted path of a
            field as in LoadScenario(), or one of ALIASES; for a System, a name as in
            Compile(...).Run(), or `seed`, the seed of Drake's SetRandomContext(). For a
            System, also a list with the numbers of each run, as for a Monte Carlo
            method.
        metrics: For a System: functions that return a number from the Recording of a
            run, by name.
        duration: For a System: the duration of the runs, s.
        context: For a System: the Context where runs begin; None: the default Context.
        simulator: For a System: the solver; None: DefaultSimulator().
        overrides: Overrides of all runs of a scenario, as in LoadScenario().
        engine: The engine, as in simulate(). `auto` compiles the runs if it can;
            otherwise `notice` gets the reason.
        executor: Where to simulate; Execution describes this and the other arguments.
        jobs: Number of worker processes; for a System, of threads.
        out: Folder to write to.
        resume: Whether to continue the sweep in `out`.
        progress: Called with the number of finished runs and the number of all runs.
        notice: Called with a line of text; None: warnings.warn.

    Returns:
        The records of all runs.

    Raises:
        ScenarioError: If a value of the grid is not valid with any of the others.
        SweepError: If the grid, jobs or the folder cannot be used.
        RuntimeError: If the executor gives up. What is finished stays in `out`.
        OSError: If a file cannot be written.
    """
    allowed = 'values by key, as {"delay": [0.1, 0.2]}'
    execution = Execution(
        executor=executor,
        jobs=jobs,
        out=out,
        resume=resume,
        progress=progress or HERE.progress,
        notice=notice or HERE.notice,
    )
    if isinstance(scenario, System) or callable(scenario):
        from teleop_drake.study.sweep.system_plan import PlanSystemSweep

        RefuseGiven("left out for a System", overrides=overrides or None)
        CheckKind("grid", grid, Mapping | Sequence, allowed)
        system_plan = PlanSystemSweep(
            scenario,
            cast(GivenGrid, grid),
            metrics=metrics,
            duration=duration,
            context=context,
            simulator=simulator,
            engine=engine,
        )
        return RunSweep(system_plan, execution)
    from teleop_drake.model.scenario.loading import CheckScenarioLike
    from teleop_drake.study.sweep.plan import PlanSweep

    CheckScenarioLike(scenario)
    CheckKind("grid", grid, Mapping, allowed)
    RefuseGiven(
        "left out for a scenario, which has its own",
        metrics=metrics,
        duration=duration,
        context=context,
        simulator=simulator,
    )
    plan = PlanSweep(
        cast(File, scenario),
        cast(GivenGrid, grid),
        overrides=overrides,
        engine=engine,
    )
    return RunSweep(plan, execution)


def RunSweep(plan: AnyPlan[R], execution: Execution = HERE) -> R:
    """Simulates the runs of a plan.

    Raises:
        SweepError: If jobs or the folder cannot be used, or a worker has other versions
            of the packages.
        RuntimeError: If the executor gives up. What is finished stays in `out`.
        OSError: If a file cannot be written.
    """
    CheckKind("plan", plan, AnyPlan, "a SweepPlan; Sweep() takes a scenario")
    jobs = execution.jobs
    if jobs is not None and jobs < 1:
        raise SweepError(f"jobs = {jobs}: must be 1 or more")
    if jobs is not None and execution.executor is not None:
        raise SweepError(f"jobs = {jobs}: must be None where an executor is given")
    num_runs = len(plan.points)
    records: dict[int, Record] = {}
    with contextlib.ExitStack() as stack:
        folder = None
        if execution.out is not None:
            out = Path(execution.out)
            folder = SweepFolder(out, plan, execution.resume, execution.notice, stack)
            records |= folder.records
        execution.progress(len(records), num_runs)
        # Each record is written as soon as its run has ended.
        missing = deque(run for run in range(num_runs) if run not in records)
        new = _SimulateRuns(plan, missing, execution)
        for record in stack.enter_context(contextlib.closing(new)):
            records[record["run"]] = record
            if folder is not None:
                folder.Append(record)
            execution.progress(len(records), num_runs)
        result = plan.Result([records[run] for run in range(num_runs)])
        if folder is not None:
            folder.Finish(result)
    return result


def RunSweeps(
    plans: Mapping[str, AnyPlan[R]], execution: Execution = HERE
) -> dict[str, R]:
    """Simulates the runs of several plans, for example the plans of a study.

    Args:
        plans: The plans by name. Each has a folder of its name in `out`.
        execution: The execution; progress is counted over all plans.

    Returns:
        The results by the names of the plans.

    Raises:
        The errors of RunSweep().
    """
    total = sum(len(plan.points) for plan in plans.values())
    results: dict[str, R] = {}
    num_before = 0

    def Report(num_finished: int, _: int) -> None:
        execution.progress(num_before + num_finished, total)

    for name, plan in plans.items():
        out = None if execution.out is None else Path(execution.out, name)
        one = replace(execution, out=out, progress=Report)
        results[name] = RunSweep(plan, one)
        num_before += len(plan.points)
    return results


def _SimulateRuns(
    plan: AnyPlan[Any], runs: deque[int], execution: Execution
) -> Generator[Record, None, None]:
    """Simulates runs of a plan and yields each record when it is complete."""
    executor = execution.executor
    jobs = execution.jobs
    if not runs:
        return
    is_compiled = False
    if plan.engine != "drake":
        why = plan.WhyNotCompiled()
        if why:
            execution.notice(f"Run in Drake's Simulator: {why}.")
        is_compiled = not why
    if executor is None and is_compiled and jobs is None and not plan.stays_here:
        yield from _SimulateHere(plan, runs)
    if not runs:
        return
    if plan.stays_here and not isinstance(executor, ThreadPoolExecutor | None):
        allowed = "a ThreadPoolExecutor, or give a function that makes the System"
        Refuse("executor", type(executor).__name__, allowed)
    if executor is None and not _IsPicklable(plan):
        # Drake's Simulator holds Python's global lock.
        threads = jobs or (os.cpu_count() or 1 if is_compiled else 1)
        with ThreadPoolExecutor(threads) as own:
            yield from _SimulateOn(own, plan, list(runs), 1)
        return
    # The compiled runs of a call share their programs.
    size = 1
    if is_compiled:
        size = max(min(_RUNS_PER_CALL, len(runs) // _MIN_CALLS), 1)
    if executor is not None:
        yield from _SimulateOn(executor, plan, list(runs), size)
        return
    # No process remains if the caller stops before the sweep has ended.
    workers = Workers(min(len(runs), jobs or os.cpu_count() or 1), __name__)
    try:
        yield from _SimulateOn(workers, plan, list(runs), size)
    except BaseException:
        workers.shutdown(cancel_futures=True)
        raise
    workers.shutdown()


def _IsPicklable(plan: AnyPlan[Any]) -> bool:
    """Returns whether a plan can be sent to a worker process."""
    try:
        pickle.dumps(replace(plan, axes={}, points=[]))
    except (pickle.PicklingError, TypeError, AttributeError):
        return False
    return True


def _SimulateHere(
    plan: AnyPlan[Any], runs: deque[int]
) -> Generator[Record, None, None]:
    """Simulates runs in this process until workers are faster; removes those done."""
    programs: Programs = {}
    num_done = 0
    total_time = 0.0
    while runs and num_done < _MAX_RUNS_HERE:
        # The first run may include compilation, so its time is not counted.
        if total_time * len(runs) > _START_OF_WORKERS * (num_done - 1) > 0:
            return
        point = plan.points[runs[0]]
        start = clock.thread_time()  # Not that of other threads.
        outcome = _SimulateOne(plan, point, programs)
        if num_done > 0:
            total_time += clock.thread_time() - start
        num_done += 1
        yield _RecordOf(plan, runs.popleft(), outcome)


def _SimulateOn(
    executor: Executor, plan: AnyPlan[Any], runs: Sequence[int], size: int
) -> Generator[Record, None, None]:
    """Simulates runs by calls of an executor, each of several runs.

    If a call is lost, for example with its worker, each of its runs is repeated by a
    call of its own. Only a run that is lost again fails.
    """
    sweep = uuid.uuid4().hex
    calls: list[Sequence[int]] = [runs[i : i + size] for i in range(0, len(runs), size)]
    lost = yield from _SimulateCalls(executor, plan, sweep, calls)
    again = [[run] for call in lost for run in call.runs]
    lost = yield from _SimulateCalls(executor, plan, sweep, again)
    for call in lost:
        outcome = _Failure(f"lost twice ({call.error})")
        for run in call.runs:
            yield _RecordOf(plan, run, outcome)


class _Lost(NamedTuple):
    """The runs of a call that was lost, and the error with which it was lost."""

    runs: Sequence[int]
    error: Exception


def _SimulateCalls(
    executor: Executor, plan: AnyPlan[Any], sweep: str, calls: Sequence[Sequence[int]]
) -> Generator[Record, None, list[_Lost]]:
    """Yields the records of the runs of each call that ends; returns the lost calls."""
    futures = {}
    for call in calls:
        # A worker does not need the axes, which may be long.
        own = replace(plan, axes={}, points=[plan.points[run] for run in call])
        futures[executor.submit(_SimulateCall, own, sweep, Versions())] = call
    lost = []
    try:
        for future in as_completed(futures):
            call = futures[future]
            outcomes = _Await(future)
            if isinstance(outcomes, Exception):
                lost.append(_Lost(call, outcomes))
                continue
            for run, outcome in zip(call, outcomes, strict=True):
                yield _RecordOf(plan, run, outcome)
    finally:
        for future in futures:
            future.cancel()
    return lost


def _Await(future: Future[list[Record]]) -> list[Record] | Exception:
    """Returns the outcomes of a call, or the error with which it was lost.

    Raises:
        RuntimeError: If the executor gave up.
        SweepError: If a worker cannot be used.
    """
    try:
        return future.result()
    except BrokenExecutor as error:
        raise RuntimeError(str(error)) from None
    except CancelledError:
        raise RuntimeError("the executor cancelled a run") from None
    except ScenarioError:
        raise
    except Exception as error:  # noqa: BLE001
        return error


def _SimulateCall(
    plan: AnyPlan[Any], sweep: str, versions: Mapping[str, str]
) -> list[Record]:
    """Simulates the runs of a plan in a worker, and returns their outcomes.

    Args:
        plan: The plan, with the points of these runs only.
        sweep: An identifier of the sweep.
        versions: The versions of the packages where the sweep was started.

    Raises:
        SweepError: If the worker has other versions.
    """
    if Versions() != versions:
        raise SweepError(
            f"executor: must have workers with {versions}, and one has {Versions()}"
        )
    programs = ProgramsOf(sweep)
    return [_SimulateOne(plan, point, programs) for point in plan.points]


def _SimulateOne(plan: AnyPlan[Any], point: Point, programs: Programs) -> Record:
    """Simulates one run and returns its outcome; a failure is one, too."""
    try:
        outcome = plan.Outcome(point, programs)
        json.dumps(outcome, allow_nan=False)
        return outcome
    except (Exception, SystemExit) as error:  # noqa: BLE001
        # Some violated contracts of Drake end in SystemExit.
        return _Failure(error)


def _RecordOf(plan: AnyPlan[Any], run: int, outcome: Record) -> Record:
    return {"run": run, "varied": plan.points[run], **outcome}


def _Failure(error: BaseException | str) -> Record:
    """Returns the outcome of a run that failed."""
    # A note names the block that raised it.
    notes = getattr(error, "__notes__", [])
    reason = " ".join(" ".join([str(error), *notes]).split())
    if not (reason and isinstance(error, str | ScenarioError | RuntimeError)):
        reason = ": ".join(filter(None, [type(error).__name__, reason]))
    return {"status": "failed", "reason": reason, "metrics": None}
