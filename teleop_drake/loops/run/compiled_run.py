"""Runs a diagram as machine code."""

import time as clock
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, Diagram, OutputPort, System
from pydrake.systems.primitives import RandomSource

from teleop_drake.loops.engine.check import CheckVisited, HoldsOwnCode
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.parameters import SetNumbers
from teleop_drake.loops.engine.past import CanWritePast, ReadPast, WritePast
from teleop_drake.loops.engine.problem import EVALUATIONS, ROWS, STEPS, TRIES, Past
from teleop_drake.loops.engine.run import CompiledRun, MakeProblem, Visited
from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.contexts import ContextsIn, SetDiscreteState
from teleop_drake.loops.framework.signals import SystemsByPath
from teleop_drake.loops.framework.solver import EVENT_ACCURACY
from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.loops.jit.native import Packed
from teleop_drake.loops.kernel.block import LongestStep
from teleop_drake.loops.numerics.instants import same_within
from teleop_drake.loops.numerics.step_polynomials import Series
from teleop_drake.loops.run.failures import IsArithmetic, ReasonOfDivergence
from teleop_drake.loops.run.inputs import CheckInitialization
from teleop_drake.loops.run.run import (
    COMPLETED,
    INTERRUPTED,
    Ending,
    FindBends,
    FindEvents,
    Interruption,
    Job,
    Outcome,
    Pace,
)
from teleop_drake.loops.run.signal_places import SignalPlaces, UnknownSignals

if TYPE_CHECKING:
    from teleop_drake.loops.engine.random_sources import Draw

_OMITTED = (
    "not in a compiled run, because they are results of the last step of a discrete "
    'plant. engine="drake" records them.'
)


class CannotCompile(ScenarioError):
    """A diagram or a solver that has no machine code; the message says why."""


@dataclass(kw_only=True)
class CompiledDiagram:
    """A diagram as machine code.

    Attributes:
        diagram: The System that was compiled.
        context: The Context where its runs begin.
        evaluator: Evaluates the rates, outputs and transitions of the blocks.
        signals: The output port of each recorded signal, by name.
        places: The columns of each recorded signal in a row, by its name.
        start: The time, states and signals at the start of a run.
        past: The signals sent through delays before the start; None: no signals.
        longest_step: The longest step that the blocks allow, s.
        is_checked: Whether all code of a user's own has been compared with Drake, or
            there is no such code.
        has_constants: Whether constants of systems differ from those of the diagram.
        omitted: The names of signals that are not recorded.
        problems: The problem of the last run, by the time of its end.
    """

    diagram: System
    context: Context
    evaluator: Evaluator
    signals: Mapping[str, OutputPort]
    places: dict[str, slice]
    start: Visited
    past: Past | None
    longest_step: float
    is_checked: bool
    has_constants: bool = False
    omitted: Sequence[str] = ()
    problems: dict[float, Packed] = field(default_factory=dict, init=False)

    @cached_property
    def systems(self) -> dict[str, System]:
        """The systems of the model by their paths."""
        return SystemsByPath(self.diagram)

    @cached_property
    def _has_final_context(self) -> bool:
        """Whether a Context of the diagram can have all that a run ends with."""
        return not self.has_constants and CanWritePast(self.evaluator)

    @cached_property
    def _has_random_sources(self) -> bool:
        return any(type(x.system) is RandomSource for x in self.evaluator.blocks)

    def _TakeDraws(self, context: Context, end: float) -> "list[Draw]":
        """Advances random sources in a Context to a time in s; returns their draws."""
        from teleop_drake.loops.engine.random_sources import TakeDraws

        return TakeDraws(self.evaluator, context, end)

    def Start(self, config: SimulatorConfig, end: float) -> CompiledRun:
        """Returns a new run, not begun yet, whose last possible time is `end` in s."""
        problem = self.problems.get(end)
        if problem is None:
            program = self.evaluator.program
            problem = MakeProblem(program, self.start.t, end, self.past)
            self.problems.clear()
            self.problems[end] = problem
        draws: list[Draw] = []
        if self._has_random_sources:
            draws = self._TakeDraws(self.context.Clone(), end)
        return CompiledRun(
            self.evaluator,
            None,
            start=self.start,
            past=self.past,
            system=problem,
            end=end,
            accuracy=config.accuracy,
            max_step=min(config.max_step_size, self.longest_step),
            is_checked=self.is_checked,
            draws=draws,
        )

    def Run(self, job: Job) -> Outcome:
        """Executes a run; compares the first run of a user's own code with Drake.

        Raises:
            KernelDisagrees: If the machine code does not compute what the diagram does.
            NearLimit: If a joint of a discrete plant comes near to its limit.
        """
        run = self.Start(job.config, self.start.t + job.duration)
        outcome = _Run(run, job, self.places, self.systems)
        self.evaluator.CheckLimits(*run.Rows())
        if self.omitted:
            outcome.notes = [f"{', '.join(self.omitted)}: {_OMITTED}"]
        if job.has_events:
            end = run.start.t + job.duration
            outcome.find_events = partial(FindEvents, run, end)
        outcome.find_bends = partial(FindBends, run)
        if self._has_final_context:
            outcome.make_final_context = partial(self._FinalContext, run)
        self.Check(run.visited)
        return outcome

    def WithNumbers(
        self,
        context: Context,
        numbers: Mapping[str, ArrayLike],
        *,
        changed: Collection[System] = (),
        suppress_initialization_events: bool = False,
        kept: Sequence[Evaluator] = (),
    ) -> "CompiledDiagram":
        """Returns the same diagram with other numbers in a Context.

        The program is kept unless the numbers need another one, for example for a delay
        of 0 s, or if numbers differ that were equal and share a place of the program.

        Args:
            context: The Context where runs begin, before its initialization events; it
                is not changed.
            numbers: New values by name, see SetNumbers().
            changed: Further systems whose numbers in the Context may differ from those
                of the program.
            suppress_initialization_events: As in Job.
            kept: Further evaluators whose machine code is reused if it is the same.

        Raises:
            ScenarioError: If there is no such number, or the value is not allowed.
            CannotCompile: If the diagram has no program with these numbers.
        """
        start = context.Clone()
        start.SetAccuracy(EVENT_ACCURACY)
        constants: dict[System, dict[str, Array]] = {}
        systems = SetNumbers(self.diagram, start, numbers, constants)
        if not suppress_initialization_events:
            self.diagram.ExecuteInitializationEvents(start)
        places = self.places
        if constants:
            # A user's own code is compared with Drake, which has the old constants.
            self.Check()
        try:
            evaluator = self.evaluator.With(
                start, systems.union(changed), kept, constants
            )
            if evaluator.program.signals is not self.evaluator.program.signals:
                places = SignalPlaces(evaluator, self.signals)
        except UnsupportedSystem as error:
            named = ", ".join(f"{key} = {Show(x)}" for key, x in numbers.items())
            raise CannotCompile(
                f"{named}: {error}; simulate(system, context=...) runs a Context with "
                "these numbers in Drake's Simulator, if that can"
            ) from error
        if constants and not suppress_initialization_events:
            from teleop_drake.loops.run.initial_modes import SetInitialModes

            SetInitialModes(evaluator, start)
        compiled = StartingAt(start, self.diagram, evaluator, self.signals, places)
        compiled.omitted = self.omitted
        compiled.systems = self.systems
        if constants:
            compiled.is_checked = True
            compiled.has_constants = True
        return compiled

    def ReadAnew(self) -> "CompiledDiagram":
        """Returns the same diagram, with a user's Python code as it stands now.

        Raises:
            CannotCompile: If the code has changed so that it cannot be followed.
        """
        if not self.evaluator.read:
            return self
        try:
            evaluator = self.evaluator.With(self.context, ())
        except UnsupportedSystem as error:
            raise CannotCompile(str(error)) from error
        places = SignalPlaces(evaluator, self.signals)
        start = self.context
        compiled = StartingAt(start, self.diagram, evaluator, self.signals, places)
        compiled.omitted = self.omitted
        return compiled

    def _FinalContext(self, run: CompiledRun) -> Context:
        """Returns the Context at the end of a run."""
        context: Context = self.context.Clone()
        time = run.next_time
        if self._has_random_sources:
            self._TakeDraws(context, time)
        context.SetTime(time)
        context.SetContinuousState(run.memory.x)
        contexts = ContextsIn(self.diagram, context)
        modes = self.evaluator.program.modes
        for block, part in zip(self.evaluator.blocks, modes, strict=True):
            SetDiscreteState(contexts[block.system], run.memory.m[part])
        WritePast(self.evaluator, context, run.memory)
        from teleop_drake.loops.run.logs import WriteLogs

        WriteLogs(run, self.evaluator, context)
        return context

    def Check(self, visited: Iterable[Visited] = ()) -> None:
        """Compares a user's own code with Drake's callbacks, unless it was done before.

        Args:
            visited: Times and states of a run where it is compared, besides the start.
        """
        if self.is_checked:
            return
        # Threads may do so at once: each has a Context of its own.
        states = [self.start, *visited]
        CheckVisited(self.evaluator, self.diagram, self.context.Clone(), states)
        self.is_checked = True


def CompileDiagram(
    diagram: System,
    config: SimulatorConfig,
    signals: Mapping[str, OutputPort],
    context: Context | None = None,
    like: Evaluator | None = None,
    *,
    suppress_initialization_events: bool = False,
    may_omit: bool = False,
    ignores_limits: bool = False,
) -> CompiledDiagram:
    """Compiles a diagram, or a block by itself.

    Args:
        config: The solver of the runs.
        signals: The output port of each recorded signal, by name.
        context: The Context where runs begin, with its parameters and fixed inputs; it
            is not changed. None: the default Context.
        like: The evaluator of another diagram, whose machine code is reused if it is
            the same.
        suppress_initialization_events: As in Job.
        may_omit: Whether outputs of a discrete plant need not be recorded that are
            results of its last step, which a program does not store.
        ignores_limits: Whether the caller expects NearLimit of a run.

    Raises:
        CannotCompile: If a block, or the solver, has no machine code.
    """
    why = WhyNotSolved(config)
    if why:
        raise CannotCompile(why)
    try:
        if not suppress_initialization_events:
            CheckInitialization(diagram, context, signals)
        context = StartOf(
            diagram,
            context,
            suppress_initialization_events=suppress_initialization_events,
        )
        evaluator = Evaluator(
            diagram,
            context,
            as_machine_code=True,
            like=like,
            recorded=signals.values(),
            ignores_limits=ignores_limits,
        )
        omitted = UnknownSignals(evaluator, signals) if may_omit else []
        signals = {name: x for name, x in signals.items() if name not in omitted}
        places = SignalPlaces(evaluator, signals)
    except UnsupportedSystem as error:
        raise CannotCompile(str(error)) from error
    compiled = StartingAt(context, diagram, evaluator, signals, places)
    compiled.omitted = omitted
    return compiled


def StartingAt(
    context: Context,
    diagram: System,
    evaluator: Evaluator,
    signals: Mapping[str, OutputPort],
    places: dict[str, slice],
) -> CompiledDiagram:
    """Returns a compiled diagram of which runs begin at a Context.

    Args:
        context: The Context, after its initialization events; it is kept.
        evaluator: The evaluator with the numbers of the Context.
        signals: As in CompiledDiagram.
        places: As in CompiledDiagram.
    """
    start = Visited(context.get_time(), *evaluator.ReadContext(context))
    return CompiledDiagram(
        diagram=diagram,
        context=context,
        evaluator=evaluator,
        signals=signals,
        places=places,
        start=start,
        past=ReadPast(evaluator, context, start.y),
        longest_step=LongestStep(diagram, context, of_delays=False),
        is_checked=not HoldsOwnCode(evaluator),
    )


def StartOf(
    diagram: System,
    context: Context | None,
    *,
    suppress_initialization_events: bool = False,
) -> Context:
    """Returns a new Context at which a compiled run begins.

    Args:
        context: The Context to copy; None: the default Context.
        suppress_initialization_events: As in Job.
    """
    start = diagram.CreateDefaultContext() if context is None else context.Clone()
    start.SetAccuracy(EVENT_ACCURACY)
    if not suppress_initialization_events:
        diagram.ExecuteInitializationEvents(start)
    return start


def StartFed(
    diagram: Diagram,
    config: SimulatorConfig,
    signals: Mapping[str, OutputPort],
    end: float,
    **inputs: Array,
) -> tuple[CompiledRun, dict[str, slice], dict[str, slice]]:
    """Returns a new run whose open inputs are set by CompiledRun.Feed().

    Args:
        config: The solver.
        signals: The output port of each signal, by name.
        end: The last time that the run may reach, s.
        inputs: The initial values of the diagram's inputs, by their names.

    Returns:
        The run, whose code has been compared with Drake at the start; the columns of
        each signal in its rows, by the signal's name; and the places that Feed() takes,
        by the names of the blocks that are fed.
    """
    context = diagram.CreateDefaultContext()
    for name, values in inputs.items():
        diagram.GetInputPort(name).FixValue(context, values)
    compiled = CompileDiagram(diagram, config, signals, context)
    compiled.Check()
    blocks = compiled.evaluator.blocks
    fed = compiled.evaluator.program.fed
    places = {blocks[i].system.get_name(): place for (i, _), place in fed.items()}
    return compiled.Start(config, end), compiled.places, places


def WhyNotSolved(config: SimulatorConfig) -> str:
    """Returns why a solver is not available in compiled runs; empty if it is."""
    if config.integration_scheme == "runge_kutta5" and config.use_error_control:
        return ""
    scheme = config.integration_scheme
    return f"compiled runs use runge_kutta5 with error control, not {scheme}"


def _Run(
    run: CompiledRun,
    job: Job,
    places: Mapping[str, slice],
    systems: Mapping[str, System],
) -> Outcome:
    """Executes a run to the end of its job, or until it ends early.

    Args:
        places: The columns of each recorded signal in a row, by its name.
        systems: The systems of the model by their paths.
    """
    bound = job.bound
    begin = run.start.t
    end = begin + job.duration
    pace = Pace(job.duration, begin)
    start = clock.monotonic()
    watched = slice(None) if bound.signal is None else places[bound.signal]
    ending = COMPLETED
    is_beyond_bound = False
    with Interruption() as interruption:
        # The start is recorded in any case.
        while run.memory.counts[ROWS] == 0 or not (
            run.time >= end - same_within(end) or ending.reason or interruption.has_come
        ):
            rows = run.Advance(end)
            pace.Check(run.memory.counts[TRIES], run.time)
            norms = _Norms(rows[:, watched])
            beyond = norms[~(norms <= bound.largest)]
            if beyond.size > 0:
                is_beyond_bound = bool(np.isfinite(beyond[0]))
                ending = Ending("diverged", bound.Reason(beyond[0]))
                del run.visited[-1:]  # Too large to be compared with Drake.
            elif run.failure or run.error is not None:
                ending = Ending("diverged", _ReasonOf(run))
            if job.progress is not None:
                job.progress(run.time)
    if interruption.has_come:  # It takes precedence, as in RunInDrake().
        ending = INTERRUPTED
    times, rows = run.Rows()
    signals = {name: rows[:, place] for name, place in places.items()}
    series = times, signals, run.Steps()
    wall_time = clock.monotonic() - start
    return OutcomeOf(run, systems, series, wall_time, ending, is_beyond_bound)


def _Norms(rows: Array) -> Array:
    """Returns the norm of each row, in a third of the time of numpy.linalg.norm."""
    norms: Array = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    return norms


def OutcomeOf(
    run: CompiledRun | None,
    systems: Mapping[str, System],
    series: Series,
    wall_time: float,
    ending: Ending,
    is_beyond_bound: bool = False,
) -> Outcome:
    """Returns the outcome of a run.

    Args:
        run: The run; None for a side of a link whose driver replaces the simulation.
        series: The times, the signals by name, and the steps.
        wall_time: Real time that the run took, s.
        ending: How the run ended.
        is_beyond_bound: As in Outcome.
    """
    counts = np.zeros(TRIES) if run is None else run.memory.counts
    return Outcome(
        engine="compiled" if run else "step",
        series=series,
        steps=int(counts[STEPS]),
        derivative_evaluations=int(counts[EVALUATIONS]),
        wall_time=wall_time,
        ending=ending,
        is_beyond_bound=is_beyond_bound,
        systems=systems,
    )


def _ReasonOf(run: CompiledRun) -> str:
    """Returns why a run diverged; raises an error of a law that is no divergence."""
    if run.error is None or run.failure:
        return run.failure
    if not (IsArithmetic(run.error) or not run.is_finite):
        raise run.error
    return ReasonOfDivergence(run.error, has_error_control=True)
