"""Runs a diagram as machine code."""

import time as clock
import weakref
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Diagram, System

from teleop_drake.channels.network import NetworkDelay
from teleop_drake.channels.packet_statistics import PacketStatistics
from teleop_drake.compiler.check import CheckVisited
from teleop_drake.compiler.engine import CompiledRun
from teleop_drake.compiler.evaluator import Evaluator
from teleop_drake.compiler.flatten import OutputOf
from teleop_drake.compiler.unsupported import UnsupportedSystem
from teleop_drake.numerics.step_polynomials import Series
from teleop_drake.scenario import AnyScenario
from teleop_drake.signals import SignalsOf
from teleop_drake.simulation.failures import (
    IsArithmetic,
    ReasonOfDivergence,
)
from teleop_drake.simulation.live import LiveRun
from teleop_drake.simulation.outcome import Outcome
from teleop_drake.simulation.run_monitor import Interruption, Pace
from teleop_drake.simulation.simulator import EVENT_ACCURACY
from teleop_drake.simulation.stepping import LongestStep
from teleop_drake.simulation.structure import Loop, Structure, WhyNotSolved
from teleop_drake.tasks import TaskOf
from teleop_drake.tasks.base import SpeedLimit

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Instants closer together than this, in s, are one to the integrator.
_SAME = 1e-12


# Programs that have agreed with their diagrams. Later runs of a structure differ in
# their parameters alone.
_checked: set[str] = set()


class CannotCompile(Exception):
    """A run that has to be Drake's; the message says why."""


def RunCompiled(
    diagram: Diagram,
    config: SimulatorConfig,
    duration: float,
    speed_limit: SpeedLimit,
    progress: Callable[[float], None] | None,
    advance: Callable[[LiveRun, float], None] | None = None,
    structure: Structure | None = None,
    loop: Loop | None = None,
) -> Outcome:
    """Runs a diagram as machine code.

    Args:
        duration: How long, s.
        progress: Called now and then with the simulated time in s.
        advance: As simulate() takes it.
        structure: Keeps the program for others; None: it is not kept.
        loop: What was kept of the diagram, with the channels for this run.

    Raises:
        CannotCompile: If a block, or the solver that is asked for, has no machine code.
        KernelDisagrees: If the machine code does not compute what the diagram does.
    """
    _CheckSolver(config)
    if loop is not None:
        start = clock.monotonic()
        run = CompiledRun(
            diagram,
            None,
            evaluator=loop.evaluator,
            start=loop.start,
            end=duration,
            accuracy=config.accuracy,
            max_step=min(config.max_step_size, loop.longest_step),
        )
        outcome = _Run(run, diagram, duration, speed_limit, progress, advance, start)
        channels = [channel for channel, _ in loop.channels.values()]
        outcome.channels = _Statistics(channels, outcome.series[0][-1])
        return outcome
    context = diagram.CreateDefaultContext()
    context.SetAccuracy(EVENT_ACCURACY)
    diagram.ExecuteInitializationEvents(context)
    start = clock.monotonic()
    longest_step = LongestStep(diagram, of_delays=False)
    try:
        run = CompiledRun(
            diagram,
            context,
            end=duration,
            accuracy=config.accuracy,
            max_step=min(config.max_step_size, longest_step),
        )
    except UnsupportedSystem as error:
        raise CannotCompile(str(error)) from error
    program = run.evaluator.program.text
    is_known = program in _checked
    _checked.add(program)
    outcome = _Run(run, diagram, duration, speed_limit, progress, advance, start)
    visited = run.visited[-1:] if is_known else [run.start, *run.visited]
    CheckVisited(run.evaluator, diagram, context, visited)
    outcome.channels = _Statistics(diagram.GetSystems(), outcome.series[0][-1])
    if structure is not None:
        structure.Keep(diagram, run.evaluator, run.start, longest_step)
    return outcome


def _Statistics(systems: Sequence[System], time: float) -> dict[str, PacketStatistics]:
    """Returns what became of the packets of network channels until a time."""
    found = {}
    for system in systems:
        if isinstance(system, NetworkDelay):
            context = system.CreateDefaultContext()
            context.SetTime(time)
            found[system.get_name()] = system.Statistics(context)
    return found


def WhyNotCompiled(scenario: AnyScenario) -> str:
    """Returns why a scenario runs in Drake's Simulator only; empty: it does not.

    Nothing is compiled for that.
    """
    try:
        _CheckSolver(scenario.simulator)
        diagram = TaskOf(scenario).MakeDiagram(scenario)
        Evaluator(diagram, diagram.CreateDefaultContext())
    except (CannotCompile, UnsupportedSystem) as error:
        return str(error)
    return ""


def _CheckSolver(config: SimulatorConfig) -> None:
    """Raises CannotCompile if another solver is asked for."""
    if why := WhyNotSolved(config):
        raise CannotCompile(why)


class _Stepper:
    """A run in machine code; see LiveRun.

    Args:
        run: The run.
        diagram: What is run.
        duration: How long, s.
        speed_limit: When to end early.
        progress: As RunCompiled() takes it.
        interruption: Ends it because of Ctrl-C.

    Attributes:
        termination: As in Recording, but for what Ctrl-C ends.
        reason: As in Recording.
        is_too_fast: As in Outcome.
    """

    def __init__(
        self,
        run: CompiledRun,
        diagram: Diagram,
        *,
        duration: float,
        speed_limit: SpeedLimit,
        progress: Callable[[float], None] | None,
        interruption: Interruption,
    ):
        self._run, self._duration = run, duration
        self._speed_limit, self._progress = speed_limit, progress
        self._interruption = interruption
        self._pace = Pace(duration)
        self._places = _Signals(run, diagram)
        # Without a tool, whatever is computed has to stay finite.
        self._watched = self._places.get("tool_velocity", slice(None))
        self._steps: list[Indices] = []
        self.termination, self.reason, self.is_too_fast = "completed", "", False

    @property
    def time(self) -> float:
        """How far the run is, s."""
        return self._run.time

    @property
    def has_ended(self) -> bool:
        """Whether it cannot go on: it diverged, or was interrupted."""
        return self.termination != "completed" or self._interruption.has_come

    def AdvanceTo(self, time: float) -> None:
        """Simulates until a time, or less far if the run ends before."""
        run, end = self._run, min(time, self._duration)
        while (
            run.time < end - _SAME
            and self.termination == "completed"
            and not (self._interruption.has_come and self._steps)
        ):
            num_before = len(run.Rows()[0])
            _, rows, steps = run.Advance(end)
            self._pace.Check(run.num_tries, run.time)
            speeds = np.linalg.norm(rows[:, self._watched], axis=1)
            too_fast = np.flatnonzero(~(speeds <= self._speed_limit.speed))
            if too_fast.size > 0:
                speed = speeds[too_fast[0]]
                self.is_too_fast = bool(np.isfinite(speed))
                self.termination = "diverged"
                self.reason = self._speed_limit.Reason(speed)
                del run.visited[-1:]  # Beyond the limit numbers are of any size.
            elif run.failure or run.error is not None:
                self.termination, self.reason = "diverged", _ReasonOf(run)
            self._steps.append(steps + num_before)
            if self._progress is not None:
                self._progress(run.time)

    def Signals(self) -> dict[str, Array]:
        """Returns all signals as they are now, by name; see simulate()."""
        row = self._run.Rows()[1][-1]
        return {name: row[place] for name, place in self._places.items()}

    def Feed(self, system: System, port: str, values: ArrayLike) -> None:
        """Sets an input that is not connected; nothing may jump thereby."""
        self._run.Feed(system, port, values)

    def Recorded(self) -> Series:
        """Returns the times (N,), the signals (N, k) and the steps so far."""
        times, rows = self._run.Rows()
        signals = {name: rows[:, place] for name, place in self._places.items()}
        return times, signals, np.concatenate(self._steps)


def _Run(
    run: CompiledRun,
    diagram: Diagram,
    duration: float,
    speed_limit: SpeedLimit,
    progress: Callable[[float], None] | None,
    advance: Callable[[LiveRun, float], None] | None,
    start: float,
) -> Outcome:
    with Interruption() as interruption:
        stepper = _Stepper(
            run,
            diagram,
            duration=duration,
            speed_limit=speed_limit,
            progress=progress,
            interruption=interruption,
        )
        if advance is None:
            stepper.AdvanceTo(duration)
        else:
            advance(stepper, duration)
    termination, reason = stepper.termination, stepper.reason
    if interruption.has_come:  # However it ended, as in Drake's Simulator.
        termination, reason = "interrupted", "interrupted by the user"
    return Outcome(
        engine="compiled",
        series=stepper.Recorded(),
        steps=run.num_steps,
        derivative_evaluations=run.num_evaluations,
        wall_time=clock.monotonic() - start,
        termination=termination,
        reason=reason,
        is_too_fast=stepper.is_too_fast,
    )


def _ReasonOf(run: CompiledRun) -> str:
    """Returns why a run cannot go on, or raises what a law raised by mistake."""
    if run.error is None or run.failure:
        return run.failure
    if not (IsArithmetic(run.error) or not run.is_finite):
        raise run.error
    return ReasonOfDivergence(run.error, has_error_control=True)


def _Signals(run: CompiledRun, diagram: Diagram) -> dict[str, slice]:
    """Returns where the outputs of the diagram's systems are in a row, by name."""
    if diagram not in _places:
        places, blocks = run.evaluator.program.signals, run.evaluator.blocks
        _places[diagram] = {
            name: places[OutputOf(blocks, port.get_system(), int(port.get_index()))]
            for name, port in SignalsOf(diagram).items()
        }
    return _places[diagram]


_places: weakref.WeakKeyDictionary[Diagram, dict[str, slice]] = (
    weakref.WeakKeyDictionary()
)
