"""The plan of a sweep of a System: its numbers, checked before anything runs."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, Diagram, System
from pydrake.systems.primitives import RandomSource

from teleop_drake.loops.engine.parameters import ScalarsIn, SetNumbers
from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.loops.framework.contexts import (
    ContextsIn,
    DiscreteState,
    SetDiscreteState,
)
from teleop_drake.loops.framework.signals import CheckSystem, NameOf, PathsIn
from teleop_drake.loops.framework.solver import DefaultSimulator
from teleop_drake.loops.framework.validation import (
    CheckChoice,
    CheckKind,
    CheckNumber,
    Refuse,
    Show,
)
from teleop_drake.loops.run.compiled_run import CannotCompile
from teleop_drake.loops.run.compiled_system import CompiledSystem
from teleop_drake.loops.run.recording import Recording
from teleop_drake.loops.run.system_run import ENGINES, MakeJob
from teleop_drake.model.run.simulate import simulate
from teleop_drake.study.sweep.any_plan import AnyPlan, CheckValues, Programs
from teleop_drake.study.sweep.result import SweepError, SweepResult
from teleop_drake.study.sweep.values import (
    SEED,
    GivenGrid,
    Point,
    PointsOf,
    SampledPoints,
)

Metrics = Mapping[str, Callable[[Recording], float]]
"""Functions that compute a number from a recording, by the names of the metrics."""

SystemMaker = Callable[[], System | tuple[System, Context]]
"""A function that makes a System, or a System and the Context where runs begin."""

# The fields of a solver; a SimulatorConfig cannot be sent to another process.
_SOLVER = ("integration_scheme", "accuracy", "max_step_size", "use_error_control")


class _Subject(NamedTuple):
    """What a process simulates.

    Attributes:
        system: The System.
        context: The Context where runs begin, before their numbers are set.
        program: The compiled System; None: Drake's Simulator runs it.
        why: Why it could not be compiled.
    """

    system: System
    context: Context
    program: CompiledSystem | None
    why: str


@dataclass(kw_only=True)
class SystemPlan(AnyPlan[SweepResult]):
    """A checked sweep of one System; see PlanSystemSweep.

    Attributes:
        system: The System, or a function that makes it.
        context: The Context where runs begin; None: the default Context, or that of the
            function.
        duration: The duration of the runs, s.
        solver: The fields of the SimulatorConfig.
        metrics: The functions of the metrics.
        subject: What this process simulates; None in another process.
    """

    system: System | SystemMaker
    context: Context | None
    duration: float
    solver: Record
    metrics: dict[str, Callable[[Recording], float]]
    subject: _Subject | None = field(default=None, repr=False)

    def __getstate__(self) -> Record:
        """Returns the fields except `subject`, which another process makes anew."""
        return {**vars(self), "subject": None}

    @property
    def stays_here(self) -> bool:
        """Whether a System was given, which cannot be sent to another process."""
        return isinstance(self.system, System)

    def Subject(self, programs: Programs) -> _Subject:
        """Returns what is simulated; makes it once in each worker."""
        if self.subject is not None:
            return self.subject
        if () not in programs:
            programs[()] = self._MakeSubject()
        found: _Subject = programs[()]
        return found

    def _MakeSubject(self) -> _Subject:
        system = self.system
        context = self.context
        if not isinstance(system, System):
            made = system()
            system, context = made if isinstance(made, tuple) else (made, None)
            CheckSystem("system", system)
        solver = SimulatorConfig(**self.solver)
        job = MakeJob(system, context, self.duration, solver)
        program = None
        why = ""
        if self.engine != "drake":
            try:
                program = CompiledSystem(system, job.context, self.duration, solver)
            except CannotCompile as error:
                why = str(error)
        return _Subject(system, job.context.Clone(), program, why)

    def ContextAt(self, point: Point, subject: _Subject) -> Context:
        """Returns a new Context where a run begins, before its numbers are set.

        Drake's SetRandomContext() resets what is not random, so that a system without
        random numbers keeps its part of the given Context.
        """
        context = subject.context.Clone()
        if SEED not in point:
            return context
        system = subject.system
        default = system.CreateDefaultContext()
        drawn = system.CreateDefaultContext()
        system.SetRandomContext(drawn, RandomGenerator(point[SEED]))
        of_default = ContextsIn(system, default)
        of_drawn = ContextsIn(system, drawn)
        for part, own in ContextsIn(system, context).items():
            if isinstance(part, Diagram):
                continue
            if isinstance(part, RandomSource) or not _AreEqual(
                of_drawn[part], of_default[part]
            ):
                _CopyNumbers(of_drawn[part], own)
        return context

    def Parameters(self) -> Record:
        """Returns the name, the solver and all numbers of the System, for JSON."""
        subject = self.Subject({})
        numbers = ScalarsIn(subject.system, subject.context)
        return {
            "system": NameOf(subject.system),
            "duration": self.duration,
            "solver": self.solver,
            "metrics": list(self.metrics),
            "start": repr(subject.context.get_time()),
            "numbers": {name: repr(number.value) for name, number in numbers.items()},
        }

    def WhyNotCompiled(self) -> str:
        """Returns why the System cannot be compiled; empty if it can."""
        return self.Subject({}).why

    def Simulate(self, point: Point, programs: Programs) -> Recording:
        """Simulates a run; runs share one program where their numbers allow it."""
        subject = self.Subject(programs)
        numbers = _NumbersAt(point)
        context = self.ContextAt(point, subject)
        if subject.program is not None:
            try:
                return subject.program.RunFrom(context, numbers)
            except CannotCompile:
                pass  # Drake's Simulator may run it.
        SetNumbers(subject.system, context, numbers)
        return simulate(
            subject.system,
            context=context,
            duration=self.duration,
            simulator=SimulatorConfig(**self.solver),
            engine="drake",
        )

    def Summary(self, recording: Recording) -> Record:
        """Returns the metrics, None for one that is not finite, and the notes."""
        metrics = {
            name: _Number(name, function(recording))
            for name, function in self.metrics.items()
        }
        notes = {"notes": recording.notes} if recording.notes else {}
        return {"duration": self.duration, "metrics": metrics, **notes}

    def Result(self, records: list[Record]) -> SweepResult:
        """Returns the result of the sweep from the records of all its runs."""
        units = dict.fromkeys(self.metrics, "")
        return SweepResult(axes=self.axes, records=records, units=units)


def PlanSystemSweep(
    system: System | SystemMaker,
    grid: GivenGrid | Sequence[Point],
    *,
    metrics: Metrics | None,
    duration: float | None,
    context: Context | None = None,
    simulator: SimulatorConfig | None = None,
    engine: str = "auto",
) -> SystemPlan:
    """Makes the plan of a sweep of a System, and checks it before anything runs.

    The arguments are those of Sweep().

    Raises:
        ScenarioError: If a value of the grid is not allowed with any of the others, or
            an argument is not allowed.
        SweepError: If the grid cannot be used.
    """
    CheckChoice("engine", engine, ENGINES)
    if context is not None and not isinstance(system, System):
        allowed = "left out: the function may return (system, context)"
        Refuse("context", "given", allowed)
    CheckKind("metrics", metrics, Mapping, "{name: function of a Recording}")
    if not metrics or not all(map(callable, metrics.values())):
        Refuse("metrics", list(metrics or {}), "functions of a Recording by name")
    CheckNumber("duration", duration, "s", above=0)
    assert duration is not None
    config = simulator or DefaultSimulator()
    if isinstance(grid, Mapping):
        axes, points = PointsOf(grid)
    else:
        axes, points = SampledPoints(grid)
    plan = SystemPlan(
        system=system,
        context=context,
        duration=duration,
        solver={name: getattr(config, name) for name in _SOLVER},
        metrics=dict(metrics),
        axes=axes,
        points=points,
        engine=engine,
    )
    subject = plan._MakeSubject()
    plan.subject = subject
    if SEED in points[0]:
        _CheckSeeds(plan, subject)

    def Load(point: Point) -> None:
        constants: dict[System, Record] | None = {}
        if subject.program is None:
            constants = None
        SetNumbers(
            subject.system, subject.context.Clone(), _NumbersAt(point), constants
        )

    CheckValues(Load, axes, points)
    return plan


def _NumbersAt(point: Point) -> Record:
    """Returns the numbers of a point, without its seed."""
    return {name: value for name, value in point.items() if name != SEED}


def _AreEqual(context: Context, other: Context) -> bool:
    """Returns whether the numbers in two Contexts of a system are equal."""
    return all(
        np.array_equal(a, b)
        for a, b in zip(_NumbersOf(context), _NumbersOf(other), strict=True)
    )


def _CopyNumbers(source: Context, target: Context) -> None:
    """Copies the state and the parameters between Contexts of one system."""
    state = source.get_continuous_state_vector().CopyToVector()
    target.get_mutable_continuous_state_vector().SetFromVector(state)
    SetDiscreteState(target, DiscreteState(source))
    for i in range(source.num_abstract_states()):
        target.get_mutable_abstract_state(i).SetFrom(source.get_abstract_state(i))
    target.get_mutable_parameters().SetFrom(source.get_parameters())


def _NumbersOf(context: Context) -> Iterator[Array]:
    """Yields the states and the numeric parameters of a Context."""
    yield context.get_continuous_state_vector().CopyToVector()
    yield DiscreteState(context)
    for i in range(context.num_numeric_parameter_groups()):
        yield context.get_numeric_parameter(i).CopyToVector()


def _CheckSeeds(plan: SystemPlan, subject: _Subject) -> None:
    """Refuses seeds that are no whole numbers, or where nothing is random."""
    seeds = [point[SEED] for point in plan.points]
    for seed in seeds:
        if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
            Refuse("grid.seed", seed, "a whole number >= 0")
    systems = [system for system, _ in PathsIn(subject.system)]
    if any(isinstance(system, RandomSource) for system in systems):
        return
    drawn = [_NumbersOf(plan.ContextAt({SEED: seed}, subject)) for seed in (0, 1)]
    if all(np.array_equal(a, b) for a, b in zip(*drawn, strict=True)):
        raise SweepError(
            f"grid.seed = {Show(seeds)}: must be left out, nothing in the System is "
            "random"
        )


def _Number(name: str, value: Any) -> float | None:
    """Returns a metric as a finite number, or None."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        Refuse(f"metrics.{name}", value, "a number")
    return number if math.isfinite(number) else None
