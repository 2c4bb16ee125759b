"""A scenario as machine code, which runs with different numbers.

The machine code contains no numbers of the scenario, so one program serves all runs.
Making a teleoperator takes far longer than running it. Therefore a run remakes only the
blocks that its changes affect: the channels, the sides of the architecture, the
operator, the environment. A change of the robot remakes the whole diagram, which still
uses the program.
"""

import copy
import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import Any

from pydrake.systems.framework import Context, System

from teleop_drake.loops.engine.check import HoldsOwnCode, ReadingDisagrees
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.run import Visited
from teleop_drake.loops.framework.contexts import ContextsIn, DiscreteState
from teleop_drake.loops.framework.signals import NamedSignals
from teleop_drake.loops.run.compiled_run import (
    CompiledDiagram,
    CompileDiagram,
    WhyNotSolved,
)
from teleop_drake.loops.run.drake_run import RunInDrake
from teleop_drake.loops.run.system_run import NoteOnDrake, NotesOnBlocks
from teleop_drake.model.blocks.architectures import Architecture
from teleop_drake.model.blocks.environments import CONTACT, FindSurface, SurfacesOf
from teleop_drake.model.blocks.robots.facts import FactsOfConfig
from teleop_drake.model.run.scenario_run import Finish, JobOf
from teleop_drake.model.scenario import (
    AnyScenario,
    CheckSteps,
    ScenarioError,
)
from teleop_drake.model.scenario.loading import LoadOverridden
from teleop_drake.model.scenario.overrides import CHANNELS
from teleop_drake.model.stations import MakeArchitecture, WithDrivesAndSensors
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks import Task, TaskOf
from teleop_drake.model.teleoperator import MakeChannelOf

# Fields of a scenario that affect no systems other than the channels, unless the
# architecture derives defaults from them.
_OF_THE_RUN = {"name", "description", "duration", "simulator", "divergence_speed_ratio"}
_OF_CHANNELS = {*_OF_THE_RUN, *CHANNELS}

# Fields that affect only systems that can be replaced in a compiled diagram.
_OF_PARTS = {
    *_OF_CHANNELS,
    *("controller", "actuator", "sensor"),
    *("environment", "surgeon", "haptic_device"),
}


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
        diagram = self._task.MakeDiagram(self._scenario)
        signals = NamedSignals(diagram.GetSystems())
        self._compiled = CompileDiagram(diagram, self._scenario.simulator, signals)

    @property
    def scenario(self) -> AnyScenario:
        """A copy of the scenario that Run() simulates without changes."""
        return copy.deepcopy(self._scenario)

    def Run(self, **changes: Any) -> TaskRecording:
        """Simulates the scenario with other numbers.

            recording = loop.Run(delay=0.07, **{"controller.G1": 3.0})

        Args:
            changes: New values by the keys of `--set`, as LoadScenario() takes them.

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
        return Finish(scenario, self._task, job, outcome, notes)

    def _Changed(self, changes: Mapping[str, Any]) -> tuple[Any, CompiledDiagram]:
        """Returns the changed scenario, and the compiled diagram that runs it."""
        scenario, replaced = LoadOverridden(self._scenario, changes)
        fields = {path.partition(".")[0] for path in replaced}
        CheckSteps(scenario)
        why = WhyNotSolved(scenario.simulator)
        if why:
            raise NeedsAnotherProgram(f"{_Named(changes)}: {why}")
        parts = self._Parts(scenario, fields)
        compiled = None if parts is None else _With(self._compiled, parts, scenario)
        # A user's own code is compared with Drake in the diagram that contains it.
        if compiled is None or HoldsOwnCode(compiled.evaluator):
            compiled = self._Remade(scenario, changes)
        return scenario, compiled

    def _Remade(self, scenario: Any, changes: Mapping[str, Any]) -> CompiledDiagram:
        """Returns a new diagram that uses the same program, or refuses the changes."""
        known = self._compiled.evaluator
        diagram = self._task.MakeDiagram(scenario)
        signals = NamedSignals(diagram.GetSystems())
        compiled = CompileDiagram(diagram, scenario.simulator, signals, like=known)
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

    def _Parts(self, scenario: Any, fields: set[str]) -> dict[str, System] | None:
        """Returns the systems that have changed, by their paths in the diagram.

        Returns None if the whole diagram has to be made again.

        Args:
            scenario: The changed scenario.
            fields: The fields of the scenario that changed.
        """
        has_channels = bool(self._task.Channels(scenario))
        if not (has_channels and _IsOfPackage(self._task) and fields <= _OF_PARTS):
            return None
        parts: dict[str, System] = {}
        architecture = self._architecture
        chosen = scenario.controller.Chosen()
        # The sides of the architecture change unless only channels do.
        is_free = _IsOfPackage(chosen) and not chosen.derives_from_channels
        if not (is_free and fields <= _OF_CHANNELS):
            environment = self._compiled.diagram.GetSubsystemByName("environment")
            _AddOutside(parts, scenario, fields, environment)
            facts = scenario.Facts(environment=parts.get("environment", environment))
            architecture = MakeArchitecture(scenario, facts=facts)
            slave_side = architecture.slave_side
            parts["controller"] = WithDrivesAndSensors(slave_side, scenario)
            master_side = architecture.master_side
            if master_side is not None:
                name = master_side.get_name() or "master_side"
                parts[f"master/{name}"] = master_side
        # Initial packets follow from the sides, so that all channels change with them.
        for name in CHANNELS:
            if not parts and not fields & {name, "duration"}:
                continue
            port = self._compiled.diagram.GetSubsystemByName(name).get_input_port()
            channel = MakeChannelOf(scenario, name, architecture, port.size())
            channel.set_name(name)
            parts[name] = channel
        return parts

    @cached_property
    def _architecture(self) -> Architecture:
        """The architecture of the unchanged scenario, outside of any diagram."""
        return MakeArchitecture(self._scenario)


def _IsOfPackage(item: object) -> bool:
    return type(item).__module__.startswith("teleop_drake.")


def _Named(changes: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {value!r}" for key, value in changes.items())


def _AddOutside(
    parts: dict[str, System], scenario: Any, fields: set[str], environment: System
) -> None:
    """Adds the changed ones of the environment, the operator and the haptic device.

    The operator perceives contact at a surface of the environment.

    Args:
        parts: The systems by their paths, to which they are added.
        scenario: The changed scenario.
        fields: The fields of the scenario that changed.
        environment: The environment of the compiled diagram.
    """
    start = scenario.robot.start
    if "environment" in fields:
        environment = scenario.environment.MakeEnvironment(start)
        parts["environment"] = environment
    if fields & {"environment", "surgeon"}:
        contact = FindSurface(SurfacesOf(environment) or (), CONTACT)
        operator = scenario.surgeon.MakeOperator(start=start, contact_surface=contact)
        operator.set_name("surgeon")
        parts["master/surgeon"] = operator
    if "haptic_device" in fields:
        device = scenario.haptic_device.MakeDevice(scenario.num_axes)
        parts["master/haptic_device"] = device


def _With(
    compiled: CompiledDiagram, parts: Mapping[str, System], scenario: Any
) -> CompiledDiagram | None:
    """Returns a compiled diagram with replaced systems, None if they do not fit.

    Args:
        parts: The new systems, by the paths of the systems that they replace.
        scenario: The changed scenario.
    """
    contexts: dict[System, Context] = {}
    for path, system in parts.items():
        contexts |= ContextsIn(system, _StartOfPart(system, path, scenario))
    try:
        evaluator = compiled.evaluator.WithBlocks(parts, contexts)
    except UnsupportedSystem:
        return None
    if evaluator is None or not _HasSteps(compiled.evaluator, evaluator):
        return None
    # Only the initial values of the new systems differ.
    program = evaluator.program
    start = Visited(compiled.start.t, *(array.copy() for array in compiled.start[1:]))
    for i, block in enumerate(evaluator.blocks):
        if block.system in contexts:
            own = contexts[block.system]
            state = own.get_continuous_state_vector()
            start.x[program.states[i]] = state.CopyToVector()
            if not program.kernels[i].delays:
                start.m[program.modes[i]] = DiscreteState(own)
    for delay, _, columns in program.delays:
        start.y[columns] = delay.initial_value
    return dataclasses.replace(
        compiled, evaluator=evaluator, start=start, parts=dict(parts)
    )


def _HasSteps(evaluator: Evaluator, other: Evaluator) -> bool:
    """Returns whether other blocks of an evaluator allow the same steps and starts."""
    pairs = zip(evaluator.blocks, other.blocks, other.program.kernels, strict=True)
    for block, own, kernel in pairs:
        steps = [getattr(x.system, "longest_step", None) for x in (block, own)]
        # The longest step of a delay matters in Drake's Simulator only.
        if steps[0] != steps[1] and not kernel.delays:
            return False
        # Only for an environment does _StartOfPart() find the initial mode.
        is_new = block.system is not own.system
        if is_new and kernel.initial_mode is not None and own.path != "environment":
            return False
    return True


def _StartOfPart(system: System, path: str, scenario: Any) -> Context:
    """Returns the initial Context of a new system.

    An environment is initialised with the tool at rest at its start position.
    """
    context = system.CreateDefaultContext()
    if path == "environment":
        position = FactsOfConfig(scenario.robot).start  # As Drake evaluates it.
        system.GetInputPort("tool_position").FixValue(context, position)
        system.GetInputPort("tool_velocity").FixValue(context, 0 * position)
        system.ExecuteInitializationEvents(context)
    return context
