"""A loop that was compiled once, and runs again with other channels.

To make, check and compile a teleoperator takes several times as long as to run it. Of
two scenarios that differ in their channels, in the duration and in the solver alone,
the second run takes over the program of the first one, and sets its delays. It gives
the same numbers to the last bit. Whatever differs otherwise is made anew, and so is a
loop whose architecture derives anything from the channels. Machine code is made anew
only for another structure: no number is in it.
"""

import copy
import dataclasses
from typing import Any, NamedTuple

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Diagram, System

from teleop_drake.architectures.facts import Facts
from teleop_drake.compiler.engine import Visited
from teleop_drake.compiler.evaluator import CompileEvaluate, Evaluator
from teleop_drake.compiler.flatten import Source
from teleop_drake.kernel import Delay, Kernel
from teleop_drake.scenario import AnyScenario
from teleop_drake.scenario.scenario import ScenarioFiles
from teleop_drake.scenario.tree import ToTree
from teleop_drake.stations import MakeArchitecture
from teleop_drake.tasks import Task

_CHANNELS = ("forward_channel", "return_channel")

# What does not decide which diagram there is, nor a number in it.
_FREE = {"name", "description", "duration", "simulator", *_CHANNELS}

# So many loops are kept: the architectures of a comparison.
_MAX_LOOPS = 8


class _IsDerived(Exception):
    """Something is derived from the channels."""


class _Facts(Facts):
    """Facts that raise where anything is derived from the channels."""

    def __getattribute__(self, name: str) -> Any:
        if name in ("duration", *_CHANNELS):
            raise _IsDerived
        return super().__getattribute__(name)


class Loop(NamedTuple):
    """A compiled loop.

    Attributes:
        diagram: What was compiled; its channels are those of the first scenario.
        evaluator: Of the diagram, with the delays of the channels.
        places: Where in a row its signals are, by their names.
        start: Where a run starts; None: where the diagram does.
        longest_step: That the blocks allow, s.
        channels: The block of each and its place among the delays, by name; none if
            others cannot take their place; None: nobody has asked yet.
    """

    diagram: Diagram
    evaluator: Evaluator
    places: dict[str, slice]
    start: Visited | None
    longest_step: float
    channels: dict[str, tuple[System, int]] | None = None


class Structure:
    """What scenarios have in common that differ in nothing but channels and times.

    Args:
        scenario: A valid one.
        task: Its task.
    """

    def __init__(self, scenario: AnyScenario, task: Task[Any]):
        self._scenario: Any = scenario
        self._channels = task.Channels(scenario)
        self._key = _Key(scenario, task) if self._channels else ""

    def Find(self) -> Loop | None:
        """Returns the loop with the channels of the scenario, if one was kept."""
        loop = _loops.get(self._key)
        if loop is None or WhyNotSolved(self._scenario.simulator):
            return None
        if loop.channels is None:
            loop = loop._replace(channels=_ChannelsIn(loop, self._scenario))
            _loops[self._key] = loop
        if not loop.channels:
            return None
        evaluator, channels = copy.copy(loop.evaluator), {}
        evaluator.program = program = copy.copy(evaluator.program)
        program.delays = list(program.delays)
        for name, (_, place) in loop.channels.items():
            before, signal, output = program.delays[place]
            channel = self._channels[name].MakeChannel(
                size=len(before.initial_value),
                initial_value=before.initial_value,
                duration=self._scenario.duration,
                stream=name,
            )
            delay = _DelayOf(channel)
            if delay is None or _WithoutTimes(delay) != _WithoutTimes(before):
                return None
            channel.set_name(name)
            channels[name] = channel, place
            program.delays[place] = delay, signal, output
        # A function of it may have been changed.
        evaluator.function = CompileEvaluate(program)
        return loop._replace(evaluator=evaluator, channels=channels)

    def Keep(self, loop: Loop) -> None:
        """Keeps a loop that was checked, perhaps for others to take over."""
        channels = map(loop.diagram.GetSubsystemByName, _CHANNELS)
        if not self._key or not all(map(_DelayOf, channels)):
            return
        if len(_loops) >= _MAX_LOOPS:
            del _loops[next(iter(_loops))]
        _loops[self._key] = loop


_loops: dict[str, Loop] = {}


def WhyNotSolved(config: SimulatorConfig) -> str:
    """Returns why machine code has not the solver that is asked for; empty: it has."""
    if config.integration_scheme == "runge_kutta5" and config.use_error_control:
        return ""
    scheme = config.integration_scheme
    return f"compiled runs use runge_kutta5 with error control, not {scheme}"


def _Key(scenario: Any, task: Task[Any]) -> str:
    """Returns what decides of a loop but for its channels; empty: it is not known.

    A user's own kind, and a file, may be another one in the next run.
    """
    fields = [x.name for x in dataclasses.fields(scenario) if x.name not in _FREE]
    kinds = [task, *(getattr(scenario, name) for name in (*fields, *_CHANNELS))]
    kinds.append(scenario.controller.Chosen())
    if any(
        not type(kind).__module__.startswith(("teleop_drake.", "builtins"))
        for kind in kinds
    ) or any(not name.startswith(_CHANNELS) for name in ScenarioFiles(scenario)):
        return ""
    return repr([type(task), *(ToTree(getattr(scenario, name)) for name in fields)])


def _ChannelsIn(loop: Loop, scenario: Any) -> dict[str, tuple[System, int]]:
    """Returns the channels of a loop if others can take their place; see Loop."""
    blocks = [block.system for block in loop.evaluator.blocks]
    program = loop.evaluator.program
    outputs = [part for _, _, part in program.delays]
    channels = {}
    for name in _CHANNELS:
        channel = loop.diagram.GetSubsystemByName(name)
        delay = _DelayOf(channel)
        assert delay is not None
        part = program.signals[Source(blocks.index(channel), delay.output)]
        channels[name] = channel, outputs.index(part)
    return channels if _IsFree(scenario, loop.diagram) else {}


def _IsFree(scenario: Any, diagram: Diagram) -> bool:
    """Returns whether an architecture derives nothing from channels and duration."""
    told = scenario.Facts(*map(diagram.GetSubsystemByName, ("robot", "environment")))
    facts = _Facts(**{x.name: getattr(told, x.name) for x in dataclasses.fields(told)})
    try:
        MakeArchitecture(scenario, facts=facts)
    except _IsDerived:
        return False
    return True


def _DelayOf(channel: System) -> Delay | None:
    """Returns what a channel does if it is a delay and nothing else."""
    kernel = channel.Kernel() if hasattr(channel, "Kernel") else None
    if kernel is None or kernel != Kernel(delays=kernel.delays[:1]):
        return None
    return next(iter(kernel.delays), None)


def _WithoutTimes(delay: Delay) -> tuple[str, str, list[float]]:
    return delay.signal, delay.output, list(delay.initial_value)
