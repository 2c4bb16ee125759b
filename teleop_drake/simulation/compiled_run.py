"""Runs a diagram as machine code."""

import functools
import importlib.util
import time as clock
from collections.abc import Callable

import numpy as np
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Diagram

from teleop_drake.channels.network import NetworkDelay
from teleop_drake.compiler.check import CheckNear
from teleop_drake.compiler.engine import CompiledRun
from teleop_drake.compiler.evaluator import Evaluator
from teleop_drake.compiler.flatten import OutputOf
from teleop_drake.compiler.unsupported import UnsupportedSystem
from teleop_drake.scenario import AnyScenario
from teleop_drake.signals import NamedSignals
from teleop_drake.simulation.failures import (
    FirstLine,
    IsArithmetic,
    ReasonOfDivergence,
)
from teleop_drake.simulation.outcome import Outcome
from teleop_drake.simulation.run_monitor import CheckPace, Interruption
from teleop_drake.simulation.simulator import EVENT_ACCURACY
from teleop_drake.simulation.stepping import LongestStep
from teleop_drake.tasks import TaskOf
from teleop_drake.tasks.base import SpeedLimit


class CannotCompile(Exception):
    """A run that has to be Drake's; the message says why."""


def RunCompiled(
    diagram: Diagram,
    config: SimulatorConfig,
    duration: float,
    speed_limit: SpeedLimit,
    progress: Callable[[float], None] | None,
) -> Outcome:
    """Runs a diagram as machine code.

    Args:
        diagram: What to run.
        config: How accurately.
        duration: How long, s.
        speed_limit: When to end early.
        progress: Called now and then with the simulated time in s. If it has a method
            Say(), that is told before what may have to be compiled.

    Raises:
        CannotCompile: If a block, the solver that is asked for, or the machine has no
            machine code.
        KernelDisagrees: If the machine code does not compute what the diagram does.
    """
    _CheckSolver(config)
    context = diagram.CreateDefaultContext()
    context.SetAccuracy(EVENT_ACCURACY)
    diagram.ExecuteInitializationEvents(context)
    start = clock.monotonic()
    say: Callable[[str], None] | None = getattr(progress, "Say", None)
    if say is not None:
        say("compiling ...")
    try:
        run = CompiledRun(
            diagram,
            context,
            end=duration,
            accuracy=config.accuracy,
            max_step=min(config.max_step_size, LongestStep(diagram, of_delays=False)),
        )
    except UnsupportedSystem as error:
        raise CannotCompile(str(error)) from error
    except Exception as error:
        if not _IsOfNumba(error):
            raise
        raise CannotCompile(f"numba: {FirstLine(error)}") from error
    CheckNear(run.evaluator, diagram, context)
    outcome = _Run(run, diagram, duration, speed_limit, progress, start)
    context.SetTime(outcome.times[-1])
    outcome.channels = {
        system.get_name(): system.Statistics(
            diagram.GetSubsystemContext(system, context)
        )
        for system in diagram.GetSystems()
        if isinstance(system, NetworkDelay)
    }
    return outcome


def WhyNotCompiled(scenario: AnyScenario) -> str:
    """Returns why a scenario runs in Drake's Simulator only; empty: it does not.

    Nothing is compiled for that.

    Args:
        scenario: A valid one.
    """
    try:
        _CheckSolver(scenario.simulator)
        diagram = TaskOf(scenario).MakeDiagram(scenario)
        Evaluator(diagram, diagram.CreateDefaultContext())
    except (CannotCompile, UnsupportedSystem) as error:
        return str(error)
    return ""


def _CheckSolver(config: SimulatorConfig) -> None:
    """Raises CannotCompile if there is no numba, or another solver is asked for."""
    if not _HasNumba():
        raise CannotCompile(
            "numba is not installed; the extra `fast` has it, and makes many runs many "
            "times as fast"
        )
    if config.integration_scheme != "runge_kutta5" or not config.use_error_control:
        raise CannotCompile(
            "compiled runs use runge_kutta5 with error control, not "
            f"{config.integration_scheme}"
        )


def _Run(
    run: CompiledRun,
    diagram: Diagram,
    duration: float,
    speed_limit: SpeedLimit,
    progress: Callable[[float], None] | None,
    start: float,
) -> Outcome:
    places = _Signals(run, diagram)
    pieces: list[tuple[np.ndarray, np.ndarray]] = []
    termination, reason, is_too_fast = "completed", "", False
    with Interruption() as interruption:
        while (
            run.time < duration
            and termination == "completed"
            and not interruption.has_come
        ):
            times, rows = run.Advance(duration)
            CheckPace(run.num_steps, run.time, duration)
            speeds = np.linalg.norm(rows[:, places["tool_velocity"]], axis=1)
            too_fast = np.flatnonzero(~(speeds <= speed_limit.speed))
            if too_fast.size > 0:
                end = int(too_fast[0])
                is_too_fast = bool(np.isfinite(speeds[end]))
                termination, reason = "diverged", speed_limit.Reason(speeds[end])
                times, rows = times[: end + is_too_fast], rows[: end + is_too_fast]
            elif run.failure or run.error is not None:
                termination, reason = "diverged", run.failure or _ReasonOf(run)
            pieces.append((times, rows))
            if progress is not None:
                progress(run.time)
    if interruption.has_come:  # However it ended, as in Drake's Simulator.
        termination, reason = "interrupted", "interrupted by the user"
    times, rows = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    return Outcome(
        times=times,
        signals={name: rows[:, place] for name, place in places.items()},
        steps=run.num_steps,
        derivative_evaluations=run.num_evaluations,
        wall_time=clock.monotonic() - start,
        termination=termination,
        reason=reason,
        is_too_fast=is_too_fast,
    )


def _ReasonOf(run: CompiledRun) -> str:
    """Returns why a run ended by what a law raised, or raises it if it is a mistake."""
    assert run.error is not None
    if not (IsArithmetic(run.error) or not run.is_finite):
        raise run.error
    return ReasonOfDivergence(run.error, has_error_control=True)


@functools.cache
def _HasNumba() -> bool:
    return all(importlib.util.find_spec(name) for name in ("numba", "scipy"))


def _IsOfNumba(error: Exception) -> bool:
    """Returns whether a function is not in the part of Python that numba knows."""
    from numba.core.errors import NumbaError

    return isinstance(error, NumbaError)


def _Signals(run: CompiledRun, diagram: Diagram) -> dict[str, slice]:
    """Returns where the outputs of the diagram's systems are in a row, by name."""
    places, blocks = run.evaluator.program.signals, run.evaluator.blocks
    return {
        name: places[OutputOf(blocks, port.get_system(), int(port.get_index()))]
        for name, port in NamedSignals(diagram.GetSystems()).items()
    }
