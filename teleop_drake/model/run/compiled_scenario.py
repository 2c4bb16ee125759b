"""A scenario as machine code, which runs with different numbers.

The machine code contains no numbers of the scenario, so one program serves all runs. A
run with other numbers sets them in the Context where it begins, under the names that
the scenario's configs give them; see ScenarioNumbers. Any other change remakes the
diagram, which takes longer than the run but still uses the program.
"""

import copy
from collections.abc import Mapping
from typing import Any

from teleop_drake.loops.engine.check import ReadingDisagrees
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.run.compiled_run import (
    CompiledDiagram,
    CompileDiagram,
    WhyNotSolved,
)
from teleop_drake.loops.run.drake_run import RunInDrake
from teleop_drake.loops.run.system_run import NoteOnDrake, NotesOnBlocks
from teleop_drake.model.run.scenario_numbers import (
    IsOfPackage,
    NumbersOf,
    ScenarioNumbers,
)
from teleop_drake.model.run.scenario_run import Finish, JobOf
from teleop_drake.model.scenario import (
    AnyScenario,
    CheckSteps,
    ScenarioError,
)
from teleop_drake.model.scenario.loading import LoadOverridden
from teleop_drake.model.signals import NamedSignals
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks import Task, TaskOf


class NeedsAnotherProgram(ScenarioError):
    """A change that needs another compiled program; the message names the key."""


class CompiledScenario:
    """A scenario as machine code; see Compile(). Threads may call Run() concurrently.

    Args:
        scenario: The scenario to compile.
    """

    def __init__(self, scenario: AnyScenario):
        scenario.Validate()
        CheckSteps(scenario)
        self._scenario: Any = copy.deepcopy(scenario)
        self._task: Task[Any] = TaskOf(scenario)
        self._compiled = self._Make(self._scenario)
        diagram = self._compiled.diagram
        self._context = diagram.CreateDefaultContext()
        self._numbers: ScenarioNumbers | None = None
        if IsOfPackage(self._task):
            self._numbers = ScenarioNumbers(self._scenario, diagram)

    @property
    def scenario(self) -> AnyScenario:
        """A copy of the scenario that Run() simulates without changes."""
        return copy.deepcopy(self._scenario)

    def Run(self, **changes: Any) -> TaskRecording:
        """Simulates the scenario with other numbers.

            recording = loop.Run(delay=0.07, **{"controller.G1": 3.0})

        Args:
            changes: New values by the keys of `--set`, as LoadScenario() takes them.
                Numbers of blocks are set in the Context, see KindConfig.Numbers(); any
                other change remakes the diagram, which takes longer.

        Raises:
            ScenarioError: If a key is unknown or a value is not allowed.
            NeedsAnotherProgram: If a change makes a loop of another structure, such as
                a delay of 0, or another kind of controller.
            KernelDisagrees: If the machine code of a user's own block does not compute
                what the block does.
        """
        if changes:
            scenario, compiled = self._Changed(changes)
        else:
            scenario, compiled = self.scenario, self._compiled
        job = JobOf(
            scenario,
            self._task,
            compiled.diagram,
            compiled.context,
            signals=compiled.signals,
        )
        notes = NotesOnBlocks(compiled.evaluator)
        try:
            outcome = compiled.Run(job)
        except ReadingDisagrees as error:
            notes = [NoteOnDrake(error)]
            outcome = RunInDrake(job)
        recording = Finish(scenario, self._task, job, outcome, notes)
        has_other = any(key.startswith("environment") for key in changes)
        if has_other and NumbersOf(scenario.environment):
            # The block reports the materials that it was made with.
            recording.surfaces = scenario.Surfaces()
        return recording

    def _Changed(self, changes: Mapping[str, Any]) -> tuple[Any, CompiledDiagram]:
        """Returns the changed scenario, and the compiled diagram that runs it."""
        scenario, _ = LoadOverridden(self._scenario, changes)
        CheckSteps(scenario)
        why = WhyNotSolved(scenario.simulator)
        if why:
            raise NeedsAnotherProgram(f"{_Named(changes)}: {why}")
        known = self._numbers
        numbers = None if known is None else known.Changed(scenario)
        if numbers is None:
            return scenario, self._Remade(scenario, changes)
        if not numbers:
            return scenario, self._compiled
        return scenario, self._compiled.WithNumbers(self._context, numbers)

    def _Make(self, scenario: Any, like: Evaluator | None = None) -> CompiledDiagram:
        """Returns a new diagram of a scenario, compiled; `like`: see CompileDiagram."""
        diagram = self._task.MakeDiagram(scenario)
        signals = NamedSignals(diagram.GetSystems())
        return CompileDiagram(diagram, scenario.simulator, signals, like=like)

    def _Remade(self, scenario: Any, changes: Mapping[str, Any]) -> CompiledDiagram:
        """Returns a new diagram that uses the same program, or refuses the changes."""
        known = self._compiled.evaluator
        compiled = self._Make(scenario, like=known)
        if compiled.evaluator.program.structure != known.program.structure:
            self._RefuseOne(changes)
            raise NeedsAnotherProgram(
                f"{_Named(changes)}: must not change the structure of the loop, for "
                "which this program was compiled; Compile() the changed scenario"
            )
        return compiled

    def _RefuseOne(self, changes: Mapping[str, Any]) -> None:
        """Refuses the first of several changes that needs another program by itself."""
        if len(changes) == 1:
            return
        for key, value in changes.items():
            try:
                self._Changed({key: value})
            except NeedsAnotherProgram:
                raise
            except ScenarioError:  # The change is valid only with others.
                continue


def _Named(changes: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {value!r}" for key, value in changes.items())
