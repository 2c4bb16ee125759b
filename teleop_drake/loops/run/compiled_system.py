"""Compiles a System of Drake's once, and runs it with different parameters."""

from collections.abc import Collection, Mapping

from numpy.typing import ArrayLike
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, System

from teleop_drake.loops.engine.check import ReadingDisagrees
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import NearLimit
from teleop_drake.loops.framework.signals import Signals, SystemsByPath
from teleop_drake.loops.framework.validation import CheckNumber
from teleop_drake.loops.run.compiled_run import CompiledDiagram, CompileDiagram
from teleop_drake.loops.run.drake_run import RunInDrake
from teleop_drake.loops.run.inputs import CheckInputs
from teleop_drake.loops.run.recording import Recording
from teleop_drake.loops.run.run import Job
from teleop_drake.loops.run.system_run import (
    CheckPeriod,
    MakeJob,
    NoteOnDrake,
    NotesOnBlocks,
    RecordingOf,
)

_HAS_CONSTANTS = (
    "Drake keeps some of the numbers as constants, which no Context has: the run has "
    "no final_context."
)


def Compile(
    system: System,
    *,
    duration: float | None,
    context: Context | None = None,
    simulator: SimulatorConfig | None = None,
    signals: Signals | None = None,
    suppress_initialization_events: bool = False,
) -> "CompiledSystem":
    """Compiles a System for many runs that differ in their numbers.

    The arguments and the errors are those of teleop_drake.Compile(), which takes
    scenarios as well.
    """
    return CompiledSystem(
        system,
        context,
        duration,
        simulator,
        signals,
        suppress_initialization_events=suppress_initialization_events,
    )


class CompiledSystem:
    """A System as machine code; see Compile(). Threads may call Run() concurrently.

    Args:
        system: The System to compile.
        context: The Context where runs begin, which is copied; None: the default
            Context at the solver's start_time.
        duration: The duration of the runs, s.
        simulator: The solver; None: DefaultSimulator().
        signals: As for simulate().
        suppress_initialization_events: As for simulate().

    Raises:
        CannotCompile: If a block, or the solver, has no machine code.
        ScenarioError: If an input is neither connected nor fixed.
    """

    def __init__(
        self,
        system: System,
        context: Context | None,
        duration: float | None,
        simulator: SimulatorConfig | None,
        signals: Signals | None = None,
        *,
        suppress_initialization_events: bool = False,
    ):
        self._job = MakeJob(
            system,
            context,
            duration,
            simulator,
            signals=signals,
            suppress_initialization_events=suppress_initialization_events,
        )
        self._job = self._job._replace(context=self._job.context.Clone())
        CheckInputs(system, self._job.context)
        self._compiled = CompileDiagram(
            system,
            self._job.config,
            self._job.signals,
            self._job.context,
            suppress_initialization_events=suppress_initialization_events,
            may_omit=self._job.has_default_signals,
            ignores_limits=True,
        )
        # Evaluators of other programs, which some numbers need.
        self._others: list[Evaluator] = []

    def Run(
        self,
        duration: float | None = None,
        *,
        publish_period: float | None = None,
        **numbers: ArrayLike,
    ) -> Recording:
        """Simulates the System with other numbers.

            recording = pendulum.Run(**{"plant.length": 2.0})

        Args:
            duration: The duration, s; None: as given for the compilation.
            publish_period: As for simulate().
            numbers: New values by the names of NamedParameters() and ScalarsIn(),
                or `delay` for all delays.

        Raises:
            ScenarioError: If there is no such number, or the value is not allowed.
            CannotCompile: If the System has no program with these numbers.
        """
        job = self._job
        if duration is not None:
            CheckNumber("duration", duration, "s", above=0)
            job = job._replace(duration=duration)
        CheckPeriod(publish_period)
        job = job._replace(publish_period=publish_period)
        self._compiled = self._compiled.ReadAnew()
        return self._Run(job, self._With(job.context, numbers))

    def RunFrom(self, context: Context, numbers: Mapping[str, ArrayLike]) -> Recording:
        """Simulates the System from another Context, with other numbers; see Run()."""
        systems = SystemsByPath(self._job.diagram).values()
        compiled = self._With(context, numbers, set(systems))
        return self._Run(self._job._replace(context=context), compiled)

    def _Run(self, job: Job, compiled: CompiledDiagram) -> Recording:
        notes = NotesOnBlocks(compiled.evaluator)
        try:
            outcome = compiled.Run(job)
        except (ReadingDisagrees, NearLimit) as error:
            if compiled.has_constants:
                raise
            job = job._replace(
                context=compiled.context, suppress_initialization_events=True
            )
            return RecordingOf(job, RunInDrake(job), [NoteOnDrake(error)])
        notes += outcome.notes
        if compiled.has_constants:
            return RecordingOf(job, outcome, notes, _HAS_CONSTANTS)
        return RecordingOf(job, outcome, notes)

    def _With(
        self,
        context: Context,
        numbers: Mapping[str, ArrayLike],
        changed: Collection[System] = (),
    ) -> CompiledDiagram:
        """Returns the compiled System with other numbers; keeps its program.

        Args:
            changed: Systems whose numbers in the Context may differ from the program's.
        """
        if not (numbers or changed):
            return self._compiled
        compiled = self._compiled.WithNumbers(
            context,
            numbers,
            changed=changed,
            suppress_initialization_events=self._job.suppress_initialization_events,
            kept=self._others,
        )
        known = [self._compiled.evaluator, *self._others]
        if compiled.evaluator.function not in [each.function for each in known]:
            self._others.append(compiled.evaluator)
        return compiled
