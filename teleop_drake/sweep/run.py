"""Sweeps: a scenario over a grid of its fields, in many processes, and resumable."""

import contextlib
import json
import multiprocessing
import os
import signal
import sys
import threading
import time as clock
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from teleop_drake.scenario import ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.simulation.compiled_run import WhyNotCompiled
from teleop_drake.sweep.folder import SweepFolder
from teleop_drake.sweep.plan import PlanSweep, PointOverrides, Source, SweepPlan
from teleop_drake.sweep.result import SweepError, SweepResult
from teleop_drake.tasks.metrics import RunSummary

# After so many runs each, processes are replaced. In Drake before 1.56 a simulation
# leaks two megabytes: a Diagram with a LeafSystem written in Python is never freed.
_RUNS_PER_PROCESS = 100

# Compiled runs that would take no longer than this, in s, than worker processes take to
# start and import, are done without.
_START_OF_WORKERS = 6.0


def Sweep(
    scenario: str | os.PathLike[str],
    grid: Mapping[str, Iterable[Any]],
    *,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    engine: str = "auto",
    **options: Any,
) -> SweepResult:
    """Simulates a scenario for each combination of values.

        Sweep("one_dof", {"controller": CONTROLLERS, "delay": np.linspace(0, 0.4, 9)})

    A run that fails is a record with its reason, and so is a combination of values
    that is not valid; the sweep goes on. A run whose process dies is tried once more.

    In a script, call this under `if __name__ == "__main__":`, because Python imports
    the script in each worker process. A notebook need not.

    Args:
        scenario: A built-in name or a YAML file.
        grid: Values by key. A key is the dotted path of a field as LoadScenario takes
            it, or one of ALIASES. The last key varies fastest.
        overrides: For all runs, as LoadScenario takes them.
        engine: As simulate() takes it; `auto` runs what can be compiled as machine
            code, and says of what cannot why.
        **options: jobs, out, resume, progress and notice, as RunSweep()
            takes them.

    Returns:
        The records of all runs.

    Raises:
        ScenarioError: If a value of the grid is not valid with any of the others.
        SweepError: If the grid, jobs or the folder cannot be used.
        RuntimeError: If no process can start. What is finished stays in `out`.
        OSError: If a file cannot be written.
    """
    plan = PlanSweep(scenario, grid, overrides=overrides, engine=engine)
    return RunSweep(plan, **options)


def RunSweep(
    plan: SweepPlan,
    *,
    part: tuple[int, int] | None = None,
    jobs: int | None = None,
    out: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
    notice: Callable[[str], None] | None = None,
) -> SweepResult:
    """Does what a plan says, or a part of it.

    Args:
        part: (I, N) for the runs I - 1, I - 1 + N and so on, whose records are all that
            the result then has; None: all runs.
        jobs: Number of worker processes, >= 1; None: as many as there are processors,
            and none for compiled runs that would be done before these have started.
        out: Folder to write to; None writes nothing.
        resume: Whether to go on with the sweep in `out`, if there is one. To have a
            run done again, delete its line in runs.jsonl.
        progress: Called with the number of runs that are finished and the number of
            all, at the start and after each.
        notice: Called with a line of text if runs cannot be machine code, or if runs in
            `out` have to be done again because their lines were changed; None:
            warnings.warn.
    """
    if jobs is not None and jobs < 1:
        raise SweepError(f"jobs = {jobs}: must be 1 or more")
    notice = notice or warnings.warn
    progress = progress or (lambda finished, runs: None)
    first, step = part or (1, 1)
    runs = range(len(plan.points))[first - 1 :: step]
    records: dict[int, dict[str, Any]] = {}

    def Missing() -> list[int]:
        return [run for run in runs if run not in records]

    def Take(new: Iterable[dict[str, Any]]) -> None:
        for record in new:
            records[record["run"]] = record
            if folder is not None:
                folder.Append(record)
            progress(len(records), len(runs))

    with (
        contextlib.nullcontext()
        if out is None
        else SweepFolder(Path(out), plan, resume, notice, part)
    ) as folder:
        if folder is not None:
            records |= folder.records
        progress(len(records), len(runs))
        if Missing() and plan.engine != "drake":
            why = WhyNotCompiled(plan.scenario)
            if why:
                notice(f"Run in Drake's Simulator: {why}.")
            elif jobs is None:
                Take(_SimulateHere(plan, Missing()))
        Take(_SimulateInProcesses(plan, Missing(), jobs or os.cpu_count() or 1))
        ordered = [records[run] for run in runs]
        result = SweepResult(scenario=plan.scenario, axes=plan.axes, records=ordered)
        if folder is not None:
            folder.Finish(result)
    return result


def _SimulateHere(plan: SweepPlan, runs: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Simulates runs of a plan in this process, until worker processes would pay."""
    times: list[float] = []
    for i, run in enumerate(runs[:_RUNS_PER_PROCESS]):
        # The first run may compile.
        if sum(times[1:]) * (len(runs) - i) > _START_OF_WORKERS * max(i - 1, 0) > 0:
            return
        start = clock.process_time()
        record = _SimulateOne(plan, _Overrides(plan, run), "auto")
        times.append(clock.process_time() - start)
        yield {"run": run, "varied": plan.points[run], **record}


def _Overrides(plan: SweepPlan, run: int) -> list[str]:
    return [*plan.overrides, *PointOverrides(plan.points[run])]


def _SimulateInProcesses(
    plan: SweepPlan, runs: Iterable[int], jobs: int
) -> Iterator[dict[str, Any]]:
    """Simulates runs of a plan in processes and yields each record as it comes.

    The death of a process breaks its pool. The runs that may have been under way are
    done again, each alone, so that only a run that ends its process fails.
    """
    # Why it is not machine code was said once for all.
    engine = "drake" if plan.engine == "drake" else "auto"
    waiting, suspects = list(runs), list[int]()
    while waiting or suspects:
        is_alone = bool(suspects)
        size = 1 if is_alone else jobs * _RUNS_PER_PROCESS
        queue = suspects if is_alone else waiting
        unfinished = dict.fromkeys(queue[:size])
        del queue[:size]
        try:
            with _Processes(min(len(unfinished), jobs)) as pool:
                futures = {
                    pool.submit(
                        _SimulateOne, plan.source, _Overrides(plan, run), engine
                    ): run
                    for run in unfinished
                }
                for future in as_completed(futures):
                    run, record = futures[future], future.result()
                    del unfinished[run]
                    yield {"run": run, "varied": plan.points[run], **record}
        except BrokenProcessPool:
            if is_alone:
                for run in unfinished:
                    reason = "its process ended, and so did the second one"
                    yield {"run": run, "varied": plan.points[run], **_Failure(reason)}
            else:
                suspects = list(unfinished)[:jobs]
                waiting = list(unfinished)[jobs:] + waiting


@contextlib.contextmanager
def _Processes(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Yields a pool of processes, which are killed if it is left by an exception.

    On Linux they are forks of a server that has imported what runs need, and stays as
    long as this process: this one may have threads, which a fork would not survive.
    macOS forbids much after a fork.
    """
    kind = "forkserver" if sys.platform == "linux" else "spawn"
    context = multiprocessing.get_context(kind)
    context.set_forkserver_preload([__name__, "llvmlite.binding"])
    others = multiprocessing.active_children()
    pool = ProcessPoolExecutor(
        jobs,
        mp_context=context,
        initializer=_BeginWorker,
        initargs=(dict(os.environ),),
    )
    try:
        try:
            pool.submit(os.getpid).result()
        except BrokenProcessPool:
            raise RuntimeError(
                "a worker process could not start; a script must keep its own work "
                'under `if __name__ == "__main__":`'
            ) from None
        yield pool
    except BaseException:
        for process in multiprocessing.active_children():
            if process not in others:
                process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _BeginWorker(environment: Mapping[str, str]) -> None:
    """Leaves Ctrl-C to the parent, ends with it, and takes over its environment."""

    def EndWithParent() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.clear()
    os.environ.update(environment)
    threading.Thread(target=EndWithParent, daemon=True).start()


def _SimulateOne(
    source: Source | SweepPlan, overrides: list[str], engine: str
) -> dict[str, Any]:
    """Simulates one run, in a worker, and returns its record."""
    try:
        recording = simulate(source.Load(overrides), engine=engine)
        if recording.termination == "interrupted":
            raise KeyboardInterrupt
        record: dict[str, Any] = {
            "status": recording.termination,
            "reason": recording.reason,
            **RunSummary(recording),
        }
        del record["solver"]["wall_time_s"], record["solver"]["real_time_factor"]
        json.dumps(record, allow_nan=False)
        return record
    except (Exception, SystemExit) as error:
        # Some violated contracts of Drake end in SystemExit.
        return _Failure(error)


def _Failure(error: BaseException | str) -> dict[str, Any]:
    # A note names the block that raised it.
    notes = getattr(error, "__notes__", [])
    reason = " ".join(" ".join([str(error), *notes]).split())
    if not (reason and isinstance(error, str | ScenarioError | RuntimeError)):
        reason = ": ".join(filter(None, [type(error).__name__, reason]))
    return {"status": "failed", "reason": reason, "metrics": None}
