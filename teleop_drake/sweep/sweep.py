"""Sweeps: a scenario over a grid of its fields, in many processes, and resumable.

A folder with a sweep has

* `sweep.json`: what is swept, so that --resume can tell whether it is the same sweep;
* `runs.jsonl`: one record per line with a checksum, added as each run ends, and put
  into the order of the grid when all have;
* `runs.csv`: the scalar metrics, one row per run, written when all have ended.

Nothing in them depends on the time or the order in which runs were done: a sweep
that was killed and resumed leaves the same bytes as one that was not. Therefore the
records lack the wall times that RunSummary has.
"""

import contextlib
import csv
import fcntl
import hashlib
import importlib.metadata
import io
import itertools
import json
import math
import os
import re
import warnings
from collections import Counter
from collections.abc import (
    Callable,
    Container,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from teleop_drake.files import Replacing
from teleop_drake.recording import Recording
from teleop_drake.scenario import (
    AnyScenario,
    CheckSteps,
    LoadScenario,
    OverriddenPaths,
    Scenario,
    ScenarioError,
    ScenarioNames,
    ScenarioToYaml,
    TrackingScenario,
)
from teleop_drake.scenario.tree import DumpYaml, ParseFile, ParseYaml, ReadText
from teleop_drake.simulation import simulate
from teleop_drake.sweep.workers import WorkerProcesses
from teleop_drake.tasks.metrics import RunSummary

MAX_RUNS = 100_000
"""Most runs of a sweep, so that a typing error cannot exhaust the memory."""

ALIASES = {
    "controller": ("controller.kind",),
    "delay": ("forward_channel.delay", "return_channel.delay"),
    "forward_delay": ("forward_channel.delay",),
    "return_delay": ("return_channel.delay",),
    "seed": ("forward_channel.seed", "return_channel.seed"),
}
"""Keys of a grid that stand for fields of the scenario."""

TELEOPERATION_METRICS = {
    "start_velocity_overshoot": "m/s",
    "puncture.time": "s",
    "puncture.velocity": "m/s",
    "puncture.force": "N",
    "puncture.velocity_overshoot": "m/s",
    "collision.time": "s",
    "collision.velocity": "m/s",
    "collision.initial_impact_force": "N",
    "collision.peak_force": "N",
    "collision.rebound_velocity": "m/s",
    "collision.settling_time": "s",
    "velocity_rms_error.*": "m/s",
    "force_rms_error.*": "N",
    "control_force_peak.*": "N",
    "control_force_variation.*": "N",
    "diverged": "",
    "diverged_at": "s",
}
"""Scalar metrics of a teleoperation and their units; * stands for each task axis."""

TRACKING_METRICS = {
    "max_error.*": "m",
    "rms_error.*": "m",
    "disturbance_rms_error.*": "N",
}
"""The same of a TrackingScenario."""

CHANNEL_METRICS = {
    "sent": "",
    "received": "",
    "lost": "",
    "loss_rate": "",
    "reordered": "",
    "late": "",
    "delay_mean": "s",
    "delay_minimum": "s",
    "delay_median": "s",
    "delay_p95": "s",
    "delay_p99": "s",
    "delay_maximum": "s",
    "age_mean": "s",
    "age_maximum": "s",
}
"""What becomes of the packets of a network channel, see PacketStatistics. In a table
the names begin with that of the channel, as in `forward_channel.age_mean`."""

_HEADLINES = (
    "start_velocity_overshoot",
    "puncture.force",
    "puncture.velocity_overshoot",
    "collision.initial_impact_force",
    "collision.peak_force",
    "collision.settling_time",
    "velocity_rms_error",
    "max_error",
    "rms_error",
)

# A value of the grid is good if it is valid together with one of so many choices of
# the other values.
_MAX_CHECKS = 61

# So many runs wait in the executor: enough for a large cluster.
_MAX_IN_FLIGHT = 1000


class SweepError(ValueError):
    """Bad input. Its text is one line: the parameter, its value and what is allowed."""


@dataclass(kw_only=True)
class SweepResult:
    """What came out of a sweep.

    Attributes:
        scenario: The first valid scenario of the grid.
        axes: Keys of the grid and their values; the last one varies fastest.
        records: One for each run, in the order of the grid: `run` (its number),
            `varied` (key to value), `status` (`completed`, `diverged` or `failed`),
            `reason` (why, if not completed) and, unless it failed, all that RunSummary
            returns but the wall times. The `metrics` of a run that failed are None.
    """

    scenario: AnyScenario
    axes: dict[str, list[Any]]
    records: list[dict[str, Any]]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(values) for values in self.axes.values())

    def Values(self, metric: str) -> np.ndarray:
        """Returns a metric, one element for each run, NaN where a run has none.

        Args:
            metric: One of MetricUnits(scenario), for example "collision.peak_force".

        Returns:
            Array of the shape of the grid.

        Raises:
            SweepError: If there is no such metric.
        """
        SelectMetrics(self.scenario, [metric])
        values = [_RecordMetrics(record).get(metric) for record in self.records]
        return np.array(
            [math.nan if value is None else value for value in values], dtype=float
        ).reshape(self.shape)

    def Status(self) -> np.ndarray:
        """Returns the status of each run as an array of text in the grid's shape."""
        return np.array([record["status"] for record in self.records]).reshape(
            self.shape
        )

    def Table(self) -> list[dict[str, Any]]:
        """Returns the rows of runs.csv: all of them have the same keys.

        They are run, the keys of the grid, status, reason and the metrics, None where
        a run has none. `pandas.DataFrame` takes them as they are.
        """
        rows = []
        for record in self.records:
            metrics = _RecordMetrics(record)
            rows.append(
                {
                    "run": record["run"],
                    **record["varied"],
                    "status": record["status"],
                    "reason": record["reason"],
                    **{name: metrics.get(name) for name in MetricUnits(self.scenario)},
                }
            )
        return rows


def Sweep(
    scenario: str | os.PathLike[str],
    grid: Mapping[str, Iterable[Any]],
    *,
    overrides: Mapping[str, Any] | Iterable[str] = (),
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
        executor: Where to simulate: any Executor whose workers can import this
            package, for example `distributed.Client(...).get_executor()`. It stays
            open. None makes WorkerProcesses.
        jobs: Number of WorkerProcesses, >= 1; None: as many as there are processors.
        out: Folder to write to; None writes nothing.
        resume: Whether to go on with the sweep in `out`, if there is one. To have a
            run done again, delete its line in runs.jsonl.
        progress: Called with the number of runs that are finished and the number of
            all, at the start and after each.
        notice: Called with a line of text if runs in `out` have to be done again,
            because their lines were changed; None: warnings.warn.

    Returns:
        The records of all runs.

    Raises:
        ScenarioError: If a value of the grid is not valid with any of the others.
        SweepError: If the grid, jobs or the folder cannot be used.
        RuntimeError: If the executor gives up. What is finished stays in `out`.
        OSError: If a file cannot be written.
    """
    plan = PlanSweep(scenario, grid, overrides=overrides)
    return RunSweep(
        plan,
        executor=executor,
        jobs=jobs,
        out=out,
        resume=resume,
        progress=progress,
        notice=notice,
    )


@dataclass(kw_only=True)
class SweepPlan:
    """A sweep that was checked, see PlanSweep.

    Attributes:
        source: The scenario.
        overrides: For all runs, as "PATH=VALUE".
        axes: Keys of the grid and their values.
        points: Key to value for each run; the last key varies fastest.
        scenario: The first point that is valid.
        traces: The files of measured delays that runs read, and a hash of each.
    """

    source: "_Source"
    overrides: list[str]
    axes: dict[str, list[Any]]
    points: list[dict[str, Any]]
    scenario: AnyScenario
    traces: dict[str, str]


def PlanSweep(
    scenario: str | os.PathLike[str],
    grid: Mapping[str, Iterable[Any]],
    *,
    overrides: Mapping[str, Any] | Iterable[str] = (),
) -> SweepPlan:
    """Checks everything about a sweep that can be wrong before it runs.

    Args:
        scenario: As Sweep takes it, and so are the others.
        grid: Values by key.
        overrides: For all runs.

    Raises:
        ScenarioError: If a value of the grid is not valid with any of the others.
        SweepError: If the grid cannot be used.
    """
    if isinstance(overrides, Mapping):
        overrides = [_Override(path, _ToPlain(x)) for path, x in overrides.items()]
    elif isinstance(overrides, str):
        overrides = [overrides]
    overrides = list(overrides)
    axes = {key: _CheckAxis(key, values) for key, values in grid.items()}
    _CheckPaths(overrides, axes)
    num_runs = math.prod(map(len, axes.values()))
    if num_runs > MAX_RUNS:
        raise SweepError(f"grid = {num_runs} runs: must be at most {MAX_RUNS}")

    traces: dict[str, str] = {}

    def Load(point: list[str]) -> AnyScenario:
        # By the name that the user gave, which the messages have.
        loaded = LoadScenario(scenario, point)
        CheckSteps(loaded)
        _CheckPaths(overrides, axes, OverriddenPaths(scenario, point))
        traces.update(_HashTraces(loaded, traces))
        return loaded

    first = _CheckValues(Load, overrides, axes)
    if "seed" in axes and not _HasRandomNumbers(first, axes):
        raise SweepError(
            f"grid.seed = {axes['seed']}: must be left out, no channel is random"
        )
    return SweepPlan(
        source=_ReadSource(scenario),
        overrides=overrides,
        axes=axes,
        points=[
            dict(zip(axes, values, strict=True))
            for values in itertools.product(*axes.values())
        ],
        scenario=first,
        traces=traces,
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
    """Does what a plan says; the arguments are those of Sweep.

    Args:
        plan: By PlanSweep.
        executor: Where to simulate.
        jobs: Number of WorkerProcesses.
        out: Folder to write to.
        resume: Whether to go on with the sweep in `out`.
        progress: Called with the numbers of finished runs and of all.
        notice: Called with what the user should know of the folder.

    Raises:
        SweepError: If jobs or the folder cannot be used.
        RuntimeError: If the executor gives up. What is finished stays in `out`.
        OSError: If a file cannot be written.
    """
    if jobs is not None and (jobs < 1 or executor is not None):
        allowed = "1 or more" if jobs < 1 else "None where an executor is given"
        raise SweepError(f"jobs = {jobs}: must be {allowed}")
    records: dict[int, dict[str, Any]] = {}
    with contextlib.ExitStack() as stack:
        folder = None
        if out is not None:
            folder = stack.enter_context(
                _Folder(Path(out), plan, resume, notice or warnings.warn)
            )
            records |= folder.records
        if progress is not None:
            progress(len(records), len(plan.points))
        runs = [run for run in range(len(plan.points)) if run not in records]
        if runs and executor is None:
            executor = WorkerProcesses(min(jobs or os.cpu_count() or 1, len(runs)))
            stack.callback(executor.shutdown, cancel_futures=True)
        if executor is not None:
            for record in _Simulate(plan, runs, executor):
                records[record["run"]] = record
                if folder is not None:
                    folder.Append(record)
                if progress is not None:
                    progress(len(records), len(plan.points))
        result = SweepResult(
            scenario=plan.scenario,
            axes=plan.axes,
            records=[records[run] for run in range(len(plan.points))],
        )
        if folder is not None:
            folder.Finish(result)
    return result


def ParseValues(text: str) -> list[Any]:
    """Returns the values that START:STOP:COUNT or A,B,... stand for.

    A range has both ends; its values are rounded to 12 digits. A list has YAML values.

    Args:
        text: For example "0:0.4:41", "0.1", "auto,4.3" or "[0.1, 0],[0.2, 0]".

    Raises:
        SweepError: If it is neither.
    """
    allowed = "must be START:STOP:COUNT or A,B,..."
    if ":" in text and not set(text) & set(",[]{}\"'"):
        try:
            start, stop, count = text.split(":")
            ends, num_values = (float(start), float(stop)), int(count)
        except ValueError:
            raise SweepError(f"{text!r}: {allowed}") from None
        if not all(map(math.isfinite, ends)):
            raise SweepError(f"{text!r}: START and STOP must be finite")
        if not 1 <= num_values <= MAX_RUNS:
            raise SweepError(f"{text!r}: COUNT must be 1 to {MAX_RUNS}")
        return [float(f"{x:.12g}") for x in np.linspace(*ends, num_values)]
    try:
        values = ParseYaml(f"[{text}]", "values")
    except ScenarioError:
        values = None
    if not isinstance(values, list) or not values:
        raise SweepError(f"{text!r}: {allowed}")
    return values


def MetricUnits(scenario: AnyScenario) -> dict[str, str]:
    """Returns the names of all scalar metrics of a scenario, and their units.

    Those of its network channels, if it has any, are among them.

    Args:
        scenario: The scenario.
    """
    if isinstance(scenario, TrackingScenario):
        units = TRACKING_METRICS
    else:
        units = TELEOPERATION_METRICS | {
            f"{name}.{key}": unit
            for name in ("forward_channel", "return_channel")
            if getattr(scenario, name).has_packet_statistics
            for key, unit in CHANNEL_METRICS.items()
        }
    return {
        name.replace("*", axis): unit
        for name, unit in units.items()
        for axis in ("xyz"[: scenario.num_axes] if name.endswith("*") else " ")
    }


def SelectMetrics(
    scenario: AnyScenario, names: Sequence[str] | None = None
) -> list[str]:
    """Returns the scalar metrics that names stand for.

    Args:
        scenario: What is simulated.
        names: Scalar metrics, or groups such as "collision" or "velocity_rms_error".
            None selects those that most people look at.

    Raises:
        SweepError: If a name stands for none.
    """
    known = MetricUnits(scenario)
    if names is None:
        return [name for name in known if name.startswith(_HEADLINES)]
    selected: dict[str, None] = {}
    for name in names:
        found = [x for x in known if x == name or x.startswith(f"{name}.")]
        if not found:
            raise SweepError(f"metric {name!r}: must be one of {', '.join(known)}")
        selected |= dict.fromkeys(found)
    return list(selected)


def FlattenMetrics(metrics: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns metrics by names such as `puncture.time` and `velocity_rms_error.x`.

    Args:
        metrics: As RunSummary has them.
        prefix: What all names begin with.
    """
    flat: dict[str, Any] = {}
    for key, value in metrics.items():
        if isinstance(value, Mapping):
            flat |= FlattenMetrics(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            axes = "xyz"[: len(value)]
            flat |= {f"{prefix}{key}.{a}": x for a, x in zip(axes, value, strict=True)}
        else:
            flat[prefix + key] = value
    return flat


def _RecordMetrics(record: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the metrics of a run and of its channels by their names."""
    return FlattenMetrics((record["metrics"] or {}) | record.get("channels", {}))


# What to do.


@dataclass(kw_only=True)
class _Source:
    """A scenario file that can be sent to another machine.

    What it names in turn, a measured trace, has to be there.

    Attributes:
        name: A built-in name, or the file's.
        text: What is in the file; None for a built-in scenario.
    """

    name: str
    text: str | None

    def Load(self, overrides: Sequence[str]) -> AnyScenario:
        if self.text is None:
            return LoadScenario(self.name, overrides)
        with TemporaryDirectory(prefix="teleop-drake-") as folder:
            path = Path(folder) / self.name
            path.write_text(self.text, encoding="utf-8")
            return LoadScenario(path, overrides)


def _ReadSource(scenario: str | os.PathLike[str]) -> _Source:
    """Returns the source of a scenario that LoadScenario takes."""
    path = Path(scenario)
    if os.fspath(scenario) in ScenarioNames():
        return _Source(name=path.name, text=None)
    tree = ParseFile(path, ReadText(path))
    for key in ("forward_channel", "return_channel"):
        channel = tree.get(key) or {}
        if channel.get("trace") is not None:
            # Relative to a file that will be elsewhere.
            channel["trace"] = str(path.parent.resolve() / channel["trace"])
    return _Source(name=path.name, text=DumpYaml(tree, sort_keys=False))


def _HashTraces(scenario: AnyScenario, known: Container[str]) -> dict[str, str]:
    """Returns the traces of a valid scenario that are not known yet, with a hash."""
    if isinstance(scenario, TrackingScenario):
        return {}
    channels = (scenario.forward_channel, scenario.return_channel)
    files = {getattr(channel, "trace", None) for channel in channels}
    return {
        file: hashlib.sha256(Path(file).read_bytes()).hexdigest()
        for file in sorted(filter(None, files))
        if file not in known
    }


def _HasRandomNumbers(scenario: AnyScenario, axes: Iterable[str]) -> bool:
    """Returns whether any run may depend on a seed."""
    return isinstance(scenario, Scenario) and (
        scenario.forward_channel.draws_random_numbers
        or scenario.return_channel.draws_random_numbers
        or any(key in _CHANNEL_KINDS for key in axes)
    )


_CHANNEL_KINDS = [
    path
    for channel in ("forward_channel", "return_channel")
    for path in (channel, f"{channel}.kind")
]


def _Version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:  # Run without being installed.
        return "unknown"


def _Parameters(plan: SweepPlan) -> dict[str, Any]:
    """Returns what makes a sweep different from others, as it is read from a file."""
    parameters = {
        "scenario": plan.scenario.name,
        "overrides": plan.overrides,
        "axes": plan.axes,
        "first_scenario": ScenarioToYaml(plan.scenario),
        "versions": {name: _Version(name) for name in ("teleop-drake", "drake")},
    }
    if plan.traces:
        parameters["traces"] = plan.traces
    return dict(json.loads(json.dumps(parameters)))


def _CheckAxis(key: str, values: Iterable[Any]) -> list[Any]:
    if isinstance(values, str):
        raise SweepError(f"grid.{key} = {values!r}: must be a list of values")
    plain = [_ToPlain(value) for value in values]
    if not plain:
        raise SweepError(f"grid.{key} = []: must have at least one value")
    try:
        json.dumps(plain, allow_nan=False)
    except (TypeError, ValueError):
        raise SweepError(
            f"grid.{key}: must have finite numbers, text, booleans, None, lists and "
            "dicts only"
        ) from None
    # 1 and 1.0 are one value, 1 and true are two.
    texts = [json.dumps(_WithFloats(value)) for value in plain]
    text, count = Counter(texts).most_common(1)[0]
    if count > 1:
        text = json.dumps(plain[texts.index(text)])
        raise SweepError(f"grid.{key}: must have different values, and {text} is twice")
    return plain


def _CheckPaths(
    overrides: Sequence[str],
    axes: Mapping[str, Any],
    replaced: Sequence[str] | None = None,
) -> None:
    """Refuses what would have no effect because a later value replaces it.

    Args:
        overrides: For all runs.
        axes: Keys of the grid.
        replaced: What the paths of the overrides and those of the keys are other names
            of; None: of themselves.
    """
    paths = [text.partition("=")[0].strip() for text in overrides]
    setters = ["overrides"] * len(paths)
    for key in axes:
        for path in ALIASES.get(key, (key,)):
            paths.append(path)
            setters.append(f"grid.{key}")
    names = list(replaced or paths)
    for i, later in enumerate(setters):
        for j, earlier in enumerate(setters[:i]):
            if later != "overrides" and f"{names[j]}.".startswith(f"{names[i]}."):
                raise SweepError(
                    f"{later}: must leave {paths[j]} alone, {earlier} sets it"
                )


def _CheckValues(
    load: Callable[[list[str]], AnyScenario],
    overrides: list[str],
    axes: Mapping[str, list[Any]],
) -> AnyScenario:
    """Refuses values that are not valid with any others, returns a valid scenario."""
    first_valid: AnyScenario | None = None
    is_good: dict[str, list[bool]] = {key: [False] * len(x) for key, x in axes.items()}
    for key, values in axes.items():
        for i in range(len(values)):
            if is_good[key][i]:
                continue
            others = {k: [i] if k == key else range(len(x)) for k, x in axes.items()}
            num_choices = math.prod(map(len, others.values()))
            stride = max(num_choices // _MAX_CHECKS, 1)
            first_error = None
            for indices in itertools.islice(
                itertools.product(*others.values()), 0, None, stride
            ):
                point = {k: axes[k][j] for k, j in zip(axes, indices, strict=True)}
                try:
                    valid = load([*overrides, *_Overrides(point)])
                except ScenarioError as error:
                    first_error = first_error or error
                    continue
                first_valid = first_valid or valid
                for k, j in zip(axes, indices, strict=True):
                    is_good[k][j] = True
                break
            else:
                assert first_error is not None
                raise first_error
    return first_valid if first_valid is not None else load(overrides)


def _ToPlain(value: Any) -> Any:
    """Returns a value without numpy, as JSON would give it back."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_ToPlain(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): _ToPlain(item) for key, item in value.items()}
    return value


def _WithFloats(value: Any) -> Any:
    """Returns a plain value whose numbers are floats, as far as they can be."""
    if isinstance(value, list):
        return [_WithFloats(item) for item in value]
    if isinstance(value, dict):
        return {key: _WithFloats(item) for key, item in value.items()}
    if isinstance(value, int) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):
            return float(value)
    return value


def _Override(path: str, value: Any) -> str:
    # In brackets, a number needs no end of document, and none is broken into lines.
    text = DumpYaml([value], default_flow_style=True, width=math.inf)
    return f"{path}={text.strip()[1:-1]}"


def _Overrides(point: Mapping[str, Any]) -> list[str]:
    """Returns the overrides that make a point of the grid."""
    return [
        _Override(path, value)
        for key, value in point.items()
        for path in ALIASES.get(key, (key,))
    ]


# Doing it.


def _Simulate(
    plan: SweepPlan, runs: Iterable[int], executor: Executor
) -> Iterator[dict[str, Any]]:
    """Simulates runs of a plan and yields each record as it comes."""
    finished: SimpleQueue[tuple[int, Future[dict[str, Any]]]] = SimpleQueue()
    pending: dict[int, Future[dict[str, Any]]] = {}
    retried: set[int] = set()

    def Submit(run: int) -> None:
        overrides = [*plan.overrides, *_Overrides(plan.points[run])]
        future = executor.submit(_SimulateOne, plan.source, overrides)
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


def _SimulateOne(source: _Source, overrides: list[str]) -> dict[str, Any]:
    """Simulates one run, in a worker, and returns its record."""
    try:
        return _Outcome(simulate(source.Load(overrides)))
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
    text = " ".join(str(error).split())
    if isinstance(error, str | ScenarioError | RuntimeError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


# Keeping it.


class _Folder:
    """A folder with a sweep, of which one process at a time may take care."""

    def __init__(
        self,
        path: Path,
        plan: SweepPlan,
        resume: bool,
        notice: Callable[[str], None],
    ):
        self._path = path
        self._notice = notice
        self._plan = plan
        self._resume = resume
        self.records: dict[int, dict[str, Any]] = {}

    def __enter__(self) -> "_Folder":
        self._stack = contextlib.ExitStack()
        try:
            self._path.mkdir(parents=True, exist_ok=True)
            self._Lock()
            self._CheckParameters()
        except OSError as error:
            self._stack.close()
            raise SweepError(
                f"{self._Title()}: must be a folder that can be written "
                f"({error.strerror})"
            ) from None
        except BaseException:
            self._stack.close()
            raise
        self._ReadRecords()
        self._journal = self._stack.enter_context(
            open(self._path / "runs.jsonl", "ab", buffering=0)
        )
        return self

    def __exit__(self, *args: object) -> None:
        self._stack.close()

    def Append(self, record: dict[str, Any]) -> None:
        """Adds a record. One system call, so that a kill can hardly tear it."""
        line = _JsonLine(record).encode()
        if self._journal.write(line) != len(line):
            raise OSError(None, "disk full", str(self._path / "runs.jsonl"))

    def Finish(self, result: SweepResult) -> None:
        """Writes all files in their final form."""
        self._Write("runs.jsonl", "".join(map(_JsonLine, result.records)))
        table = result.Table()
        text = io.StringIO()
        writer = csv.DictWriter(text, table[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: _Cell(x) for key, x in row.items()} for row in table)
        self._Write("runs.csv", text.getvalue())

    def _Title(self) -> str:
        return f"out = {str(self._path)!r}"

    def _Lock(self) -> None:
        descriptor = os.open(self._path, os.O_RDONLY)
        self._stack.callback(os.close, descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SweepError(f"{self._Title()}: in use by another sweep") from None

    def _CheckParameters(self) -> None:
        mine = _Parameters(self._plan)
        file = self._path / "sweep.json"
        if not file.exists():
            if (self._path / "runs.jsonl").exists():
                raise SweepError(
                    f"{self._Title()}: must be a folder without the runs.jsonl of "
                    "something else"
                )
            self._Write("sweep.json", json.dumps(mine, indent=2) + "\n")
            return
        if not self._resume:
            raise SweepError(
                f"{self._Title()}: holds a sweep already; resume it, or choose another "
                "folder"
            )
        try:
            theirs = dict(json.loads(file.read_bytes()))
        except (ValueError, TypeError):
            theirs = {}
        different = [key for key in mine | theirs if theirs.get(key) != mine.get(key)]
        if different:
            raise SweepError(
                f"{self._Title()}: holds a sweep with other parameters "
                f"({', '.join(different)}), which cannot be resumed by this one"
            )

    def _ReadRecords(self) -> None:
        """Reads the records that are as they were written, and drops the others."""
        file = self._path / "runs.jsonl"
        text = file.read_bytes() if file.exists() else b""
        lines = []
        num_changed = 0
        # The last one may lack its end, because a kill has torn it.
        for line in re.findall(rb".*\n", text):
            record = _ReadLine(line, self._plan.points)
            if record is None:
                num_changed += 1
            elif record["run"] not in self.records:
                self.records[record["run"]] = record
                lines.append(line)
        if num_changed:
            self._notice(
                f"{self._Title()}: {num_changed} lines of runs.jsonl are not as they "
                "were written; their runs are done again"
            )
        if b"".join(lines) != text:
            self._Write("runs.jsonl", b"".join(lines).decode())

    def _Write(self, name: str, text: str) -> None:
        with Replacing(self._path / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _JsonLine(record: dict[str, Any]) -> str:
    """Returns a line of runs.jsonl: the record and a checksum of it."""
    text = json.dumps(record, allow_nan=False)
    checksum = hashlib.sha256(text.encode()).hexdigest()[:16]
    return json.dumps(record | {"checksum": checksum}) + "\n"


def _ReadLine(
    line: bytes, points: Sequence[Mapping[str, Any]]
) -> dict[str, Any] | None:
    """Returns the record of a line, or None if it is not as it was written.

    Args:
        line: Of runs.jsonl, with its end.
        points: Key to value for each run.
    """
    try:
        record = dict(json.loads(line))
        del record["checksum"]
        if (
            _JsonLine(record).encode() == line
            and 0 <= record["run"] < len(points)
            and record["varied"] == points[record["run"]]
        ):
            return record
    except (ValueError, LookupError, TypeError, RecursionError):
        pass
    return None


def _Cell(value: Any) -> Any:
    """Returns what the CSV has: an empty cell for None, and JSON for what is nested."""
    return json.dumps(value) if isinstance(value, bool | list | dict) else value
