"""Runs a diagram as machine code."""

import time as clock

import numpy as np
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, Diagram

from teleop_drake.arrays import Array, Indices
from teleop_drake.compiler.check import CheckVisited
from teleop_drake.compiler.engine import CompiledRun
from teleop_drake.compiler.evaluator import Evaluator
from teleop_drake.compiler.flatten import OutputOf, UnsupportedSystem
from teleop_drake.integrator.problem import EVALUATIONS, SAME, STEPS, TRIES
from teleop_drake.numerics.step_polynomials import Series
from teleop_drake.scenario import AnyScenario
from teleop_drake.signals import SignalsOf
from teleop_drake.simulation.failures import IsArithmetic, ReasonOfDivergence
from teleop_drake.simulation.run import Interruption, Job, Outcome, Pace
from teleop_drake.simulation.simulator import EVENT_ACCURACY
from teleop_drake.simulation.stepping import LongestStep
from teleop_drake.simulation.structure import Loop, Structure, WhyNotSolved
from teleop_drake.tasks import TaskOf
from teleop_drake.validation import ScenarioError

# Programs that have agreed with their diagrams. Later runs of a structure differ in
# their parameters alone.
_checked: set[str] = set()


class CannotCompile(ScenarioError):
    """A run that has to be Drake's; the message says why."""


def RunCompiled(
    job: Job, structure: Structure | None = None, loop: Loop | None = None
) -> Outcome:
    """Runs a diagram as machine code.

    Args:
        structure: Keeps the program for others; None: it is not kept.
        loop: What was kept of the diagram, with the blocks for this run.

    Raises:
        CannotCompile: If a block, or the solver that is asked for, has no machine code.
        KernelDisagrees: If the machine code does not compute what the diagram does.
    """
    diagram, context = job.diagram, None
    if loop is None:
        loop, context = CompileLoop(diagram, job.config)
    run = StartRun(loop, context, job.config, job.duration)
    outcome = _Run(run, job, loop.places)
    if context is None:
        outcome.TakeStatistics(loop.parts.values())
        return outcome
    program = loop.evaluator.program.text
    is_known = program in _checked
    visited = run.visited[-1:] if is_known else [run.start, *run.visited]
    CheckVisited(loop.evaluator, diagram, context, visited)
    _checked.add(program)
    outcome.TakeStatistics(diagram.GetSystems())
    if structure is not None:
        structure.Keep(loop._replace(start=run.start))
    return outcome


def CompileLoop(
    diagram: Diagram, config: SimulatorConfig, **inputs: Array
) -> tuple[Loop, Context]:
    """Compiles a diagram, and returns where it starts; see RunCompiled().

    Args:
        inputs: What the inputs of the diagram are fed with at first, by their names.
    """
    if why := WhyNotSolved(config):
        raise CannotCompile(why)
    context = diagram.CreateDefaultContext()
    context.SetAccuracy(EVENT_ACCURACY)
    for name, values in inputs.items():
        diagram.GetInputPort(name).FixValue(context, values)
    diagram.ExecuteInitializationEvents(context)
    try:
        evaluator = Evaluator(diagram, context, as_machine_code=True)
    except UnsupportedSystem as error:
        raise CannotCompile(str(error)) from error
    longest_step = LongestStep(diagram, context, of_delays=False)
    places = SignalPlaces(evaluator, diagram)
    return Loop(diagram, evaluator, places, None, longest_step), context


def StartRun(
    loop: Loop, context: Context | None, config: SimulatorConfig, end: float
) -> CompiledRun:
    """Returns the run of a loop until a time in s; it has not begun."""
    return CompiledRun(
        loop.evaluator,
        context,
        start=loop.start,
        end=end,
        accuracy=config.accuracy,
        max_step=min(config.max_step_size, loop.longest_step),
    )


def StartFed(
    diagram: Diagram, config: SimulatorConfig, end: float, **inputs: Array
) -> tuple[CompiledRun, dict[str, slice], dict[str, slice]]:
    """Returns a run until a time in s that is fed, as its CompiledRun.Feed() has it.

    Args:
        inputs: What the inputs of the diagram are fed with at first, by their names.

    Returns:
        The run, which agrees with the diagram where it starts; where the signals are in
        its rows, by their names; and what is fed, by the names of the blocks.
    """
    loop, context = CompileLoop(diagram, config, **inputs)
    run = StartRun(loop, context, config, end)
    CheckVisited(loop.evaluator, diagram, context, [run.start])
    fed, blocks = loop.evaluator.program.fed, loop.evaluator.blocks
    places = {blocks[i].system.get_name(): place for (i, _), place in fed.items()}
    return run, loop.places, places


def WhyNotCompiled(scenario: AnyScenario) -> str:
    """Returns why a scenario runs in Drake's Simulator only; empty: it does not.

    Nothing is compiled for that.
    """
    if why := WhyNotSolved(scenario.simulator):
        return why
    try:
        diagram = TaskOf(scenario).MakeDiagram(scenario)
        Evaluator(diagram, diagram.CreateDefaultContext())
    except UnsupportedSystem as error:
        return str(error)
    return ""


def _Run(run: CompiledRun, job: Job, places: dict[str, slice]) -> Outcome:
    """Runs to the end of a job, or less far.

    Args:
        places: Where in a row the signals are that are recorded, by their names.
    """
    limit, pace, start = job.speed_limit, Pace(job.duration), clock.monotonic()
    # Without a tool, whatever is computed has to stay finite.
    watched = places.get("tool_velocity", slice(None))
    steps: list[Indices] = []
    termination, reason, is_too_fast = "completed", "", False
    with Interruption() as interruption:
        while run.time < job.duration - SAME and not (
            steps and (reason or interruption.has_come)
        ):
            num_before = len(run.Rows()[0])
            _, rows, new_steps = run.Advance(job.duration)
            steps.append(new_steps + num_before)
            pace.Check(run.memory.counts[TRIES], run.time)
            speeds = np.linalg.norm(rows[:, watched], axis=1)
            too_fast = speeds[~(speeds <= limit.speed)]
            if too_fast.size > 0:
                is_too_fast = bool(np.isfinite(too_fast[0]))
                termination, reason = "diverged", limit.Reason(too_fast[0])
                del run.visited[-1:]  # Beyond the limit numbers are of any size.
            elif run.failure or run.error is not None:
                termination, reason = "diverged", _ReasonOf(run)
            if job.progress is not None:
                job.progress(run.time)
    if interruption.has_come:  # However it ended, as in Drake's Simulator.
        termination, reason = "interrupted", "interrupted by the user"
    times, rows = run.Rows()
    signals = {name: rows[:, place] for name, place in places.items()}
    series = times, signals, np.concatenate(steps)
    wall_time = clock.monotonic() - start
    return OutcomeOf(run, series, wall_time, termination, reason, is_too_fast)


def OutcomeOf(
    run: CompiledRun | None,
    series: Series,
    wall_time: float,
    termination: str,
    reason: str,
    is_too_fast: bool = False,
) -> Outcome:
    """Returns the outcome of a run; None: of a driver, nothing is simulated."""
    counts = np.zeros(TRIES) if run is None else run.memory.counts
    return Outcome(
        engine="compiled" if run else "step",
        series=series,
        steps=int(counts[STEPS]),
        derivative_evaluations=int(counts[EVALUATIONS]),
        wall_time=wall_time,
        termination=termination,
        reason=reason,
        is_too_fast=is_too_fast,
    )


def _ReasonOf(run: CompiledRun) -> str:
    """Returns why a run cannot go on, or raises what a law raised by mistake."""
    if run.error is None or run.failure:
        return run.failure
    if not (IsArithmetic(run.error) or not run.is_finite):
        raise run.error
    return ReasonOfDivergence(run.error, has_error_control=True)


def SignalPlaces(evaluator: Evaluator, diagram: Diagram) -> dict[str, slice]:
    """Returns where the outputs of the diagram's systems are in a row, by name."""
    places, blocks = evaluator.program.signals, evaluator.blocks
    return {
        name: places[OutputOf(blocks, port.get_system(), int(port.get_index()))]
        for name, port in SignalsOf(diagram).items()
    }
