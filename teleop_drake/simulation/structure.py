"""A loop that was compiled once, and runs again with other channels, gains, layers.

To make, check and compile a teleoperator takes several times as long as to run it. Of
two scenarios that differ in their channels, their environment, the parameters of their
controller, the duration and the solver alone, the second run takes over the program of
the first one: only the blocks are made anew that differ, and the program gets their
numbers. It gives the same numbers to the last bit. A loop that differs otherwise is
made anew, and so is one of another structure. Machine code is made anew only for
another structure: no number is in it.
"""

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Diagram, System

from teleop_drake.architectures.facts import Facts
from teleop_drake.compiler.engine import Visited
from teleop_drake.compiler.evaluator import CompileEvaluate, Evaluator, KernelOf
from teleop_drake.compiler.flatten import Block, Flatten, Source, UnsupportedSystem
from teleop_drake.contexts import ContextsIn, DiscreteState
from teleop_drake.environments import CONTACT, FindSurface, SurfacesOf
from teleop_drake.kernel import Kernel
from teleop_drake.robots import RobotConfig
from teleop_drake.robots.facts import FactsOfConfig
from teleop_drake.scenario import AnyScenario
from teleop_drake.scenario.scenario import ScenarioFiles
from teleop_drake.scenario.tree import ToTree
from teleop_drake.stations import MakeArchitecture
from teleop_drake.tasks import Task

_CHANNELS = ("forward_channel", "return_channel")

# Of these only the kind decides which program there is; see _Key.
_NUMBERS = ("environment", "controller")

# What does not decide which diagram there is, nor a number in it.
_FREE = {"name", "description", "duration", "simulator", "divergence_speed_ratio"}

# So many loops are kept: the architectures of a comparison.
_MAX_LOOPS = 8


class _Facts(Facts):
    """Facts that note whether anything is derived from the channels."""

    is_free = True

    def __getattribute__(self, name: str) -> Any:
        if name in ("duration", *_CHANNELS):
            vars(self)["is_free"] = False
        return super().__getattribute__(name)


class Loop(NamedTuple):
    """A compiled loop.

    Attributes:
        diagram: What was compiled, with the blocks of the first scenario.
        evaluator: Of the diagram, with the blocks of the last one.
        places: Where in a row its signals are, by their names.
        start: Where a run starts; None: where the diagram does.
        longest_step: That the blocks allow, s.
        numbers: Of the last scenario; see _Key.
        packets: What comes out of each channel at first; none: nobody has asked yet.
        is_free: Whether the architecture derives nothing from channels and duration.
        parts: Systems of the last scenario by their paths, the environment among them.
    """

    diagram: Diagram
    evaluator: Evaluator
    places: dict[str, slice]
    start: Visited | None
    longest_step: float
    numbers: tuple[str, str] = ("", "")
    packets: Sequence[Sequence[float]] = ()
    is_free: bool = False
    parts: Mapping[str, System] = MappingProxyType({})


class Structure:
    """What scenarios have in common that differ in their numbers.

    Args:
        scenario: A valid one.
        task: Its task.
    """

    def __init__(self, scenario: AnyScenario, task: Task[Any]):
        self._scenario: Any = scenario
        self._channels = task.Channels(scenario)
        self._key, self._numbers = "", ("", "")
        if self._channels:
            self._key, self._numbers = _Key(scenario, task)

    def Find(self) -> Loop | None:
        """Returns the loop with the numbers of the scenario, if one was kept."""
        loop = _loops.get(self._key)
        if loop is None or WhyNotSolved(self._scenario.simulator):
            return None
        scenario, parts = self._scenario, dict[str, System]()
        if not loop.is_free or loop.numbers != self._numbers:
            environment = loop.parts["environment"]
            if loop.numbers[0] != self._numbers[0]:
                start = scenario.robot.start
                environment = scenario.environment.MakeEnvironment(start)
                contact = FindSurface(SurfacesOf(environment) or (), CONTACT)
                parts["environment"] = environment
                parts["master/surgeon"] = scenario.surgeon.MakeOperator(
                    start=start, contact_surface=contact
                )
            facts = _Facts(**vars(scenario.Facts(environment=environment)))
            made = MakeArchitecture(scenario, facts=facts)
            is_ideal = scenario.actuator.is_ideal and scenario.sensor.is_ideal
            parts["controller" if is_ideal else "controller/law"] = made.slave_side
            if (side := made.master_side) is not None:
                parts[f"master/{side.get_name() or 'master_side'}"] = side
            packets = made.initial_forward_packet, made.initial_return_packet
            loop = loop._replace(packets=packets, is_free=facts.is_free)
        for name, packet in zip(_CHANNELS, loop.packets, strict=True):
            parts[name] = channel = self._channels[name].MakeChannel(
                size=len(packet),
                initial_value=packet,
                duration=scenario.duration,
                stream=name,
            )
            channel.set_name(name)
        found = _With(loop._replace(numbers=self._numbers), parts, scenario.robot)
        if found is not None:
            _loops[self._key] = found
        return found

    def Keep(self, loop: Loop) -> None:
        """Keeps a loop that was checked, perhaps for others to take over."""
        if not self._key:
            return
        if len(_loops) >= _MAX_LOOPS:
            del _loops[next(iter(_loops))]
        parts = {"environment": loop.diagram.GetSubsystemByName("environment")}
        _loops[self._key] = loop._replace(numbers=self._numbers, parts=parts)


_loops: dict[str, Loop] = {}


def WhyNotSolved(config: SimulatorConfig) -> str:
    """Returns why machine code has not the solver that is asked for; empty: it has."""
    if config.integration_scheme == "runge_kutta5" and config.use_error_control:
        return ""
    scheme = config.integration_scheme
    return f"compiled runs use runge_kutta5 with error control, not {scheme}"


def _Key(scenario: Any, task: Task[Any]) -> tuple[str, tuple[str, str]]:
    """Returns what decides of a loop, and the numbers that can be set in it.

    The first is empty if it is not known: a user's own kind, and a file, may be another
    one in the next run.
    """
    tree = {key: x for key, x in ToTree(scenario).items() if key not in _FREE}
    kinds = [task, scenario.controller.Chosen()]
    kinds += [getattr(scenario, name) for name in tree]
    if any(
        not type(kind).__module__.startswith(("teleop_drake.", "builtins"))
        for kind in kinds
    ) or any(not name.startswith(_CHANNELS) for name in ScenarioFiles(scenario)):
        return "", ("", "")
    decisive = [type(task), type(scenario.environment), scenario.controller.kind]
    for name in _CHANNELS:
        tree[name] = getattr(scenario, name).IsPassThrough()
    environment, controller = (repr(tree.pop(name)) for name in _NUMBERS)
    return repr([decisive, tree]), (environment, controller)


def _With(loop: Loop, parts: dict[str, System], robot: RobotConfig) -> Loop | None:
    """Returns a loop with other systems in their places, None if they do not fit."""
    evaluator, start = copy.copy(loop.evaluator), loop.start
    assert start is not None
    blocks, program = list(evaluator.blocks), evaluator.program
    kernels, x, m, y = list(program.kernels), *(a.copy() for a in start[1:])
    for path, system in parts.items():
        context = system.CreateDefaultContext()
        if path == "environment":
            place = FactsOfConfig(robot).start  # As Drake's numbers have it.
            system.GetInputPort("tool_position").FixValue(context, place)
            system.GetInputPort("tool_velocity").FixValue(context, 0 * place)
            system.ExecuteInitializationEvents(context)
        contexts, others = ContextsIn(system, context), Flatten(system, path)
        inside = [f"{block.path}/".startswith(f"{path}/") for block in blocks]
        if len(others) != sum(inside):
            return None
        for i, other in enumerate(others, first := inside.index(True)):
            own, block = contexts[other.system], blocks[i]
            state, mode = own.get_continuous_state_vector(), DiscreteState(own)
            try:
                kernel = KernelOf(other.system, own)
            except UnsupportedSystem:
                return None
            if kernel.delays:  # What they remember is for Drake alone.
                mode = m[program.modes[i]]
            inputs = {
                port: Source(source.block + first, source.port)
                for port, source in other.inputs.items()
            }
            if (
                _Outline(other, kernel) != _Outline(block, kernels[i])
                or not inputs.items() <= block.inputs.items()
                or x[program.states[i]].size != state.size()
                or m[program.modes[i]].size != mode.size
                or (kernel.initial_mode is not None and path != "environment")
            ):
                return None
            blocks[i] = dataclasses.replace(block, system=other.system)
            kernels[i] = kernel
            x[program.states[i]], m[program.modes[i]] = state.CopyToVector(), mode
    other_program = program.With(kernels)
    if other_program is None:
        return None
    for delay, _, part in other_program.delays:
        y[part] = delay.initial_value
    evaluator.blocks, evaluator.program = blocks, other_program
    # A function of it may have been changed.
    evaluator.function = CompileEvaluate(other_program)
    return loop._replace(
        evaluator=evaluator,
        start=Visited(start.t, x, m, y),
        parts={**loop.parts, **parts},
    )


def _Outline(block: Block, kernel: Kernel) -> list[Any]:
    """Returns what is in a program of a block, without its numbers."""
    system, names = block.system, dict.fromkeys(kernel.parameters)
    outputs = map(system.get_output_port, range(system.num_output_ports()))
    return [
        block.path,
        [port.size() for port in outputs],
        dataclasses.replace(kernel, parameters=names, derived={}, delays=()),
        [(x.signal, x.output, len(x.initial_value)) for x in kernel.delays],
        # That of delays is Drake's alone.
        None if kernel.delays else getattr(system, "longest_step", None),
    ]
