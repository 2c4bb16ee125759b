"""The events of a System's run that its blocks locate, by their names.

They are the guards of kernels that become 0 or more within a step, as
`path/system.transition`, and the surfaces that a tool passes into the material, as
`path/system.surface`. A change that follows at the same instant from a jump or from
another event is not listed.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from pydrake.systems.framework import Context, OutputPort, System

from teleop_drake.loops.engine.flatten import Flatten
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import SystemsByPath
from teleop_drake.loops.kernel.delay_line import DelayLine
from teleop_drake.loops.numerics.instants import same_within
from teleop_drake.loops.numerics.pieces import Pieces
from teleop_drake.loops.numerics.step_polynomials import Series
from teleop_drake.loops.run.bends import Kinked
from teleop_drake.loops.run.recording import Event
from teleop_drake.loops.run.run import Job, Outcome

# The attributes of blocks that are watched.
_WATCHED = ("has_guards", "Surfaces", "delays")

# The input of a block with surfaces that has the position of what meets them.
_POSITION = "tool_position"


def CompiledEvents(run: CompiledRun, end: float, outcome: Outcome) -> list[Event]:
    """Returns the events of a compiled run.

    Args:
        run: The run.
        end: The time of its end, s; what is due then does not happen.
        outcome: The outcome, with the part of the run that is recorded.
    """
    evaluator = run.evaluator
    program = evaluator.program
    times, rows = run.Rows()
    steps = run.Steps()
    places = [0, *steps[:, -1]]
    transitions = iter(program.transitions)
    events = []
    for block, kernel in zip(evaluator.blocks, program.kernels, strict=True):
        for name in kernel.transitions:
            _, guard, _, _ = next(transitions)
            if guard is not None:
                is_due = rows[places, guard.start] >= 0
                found = times[places][is_due]
                events += [Event(name=f"{block.path}.{name}", time=t) for t in found]
        source = block.inputs.get(_POSITION)
        if source is not None and source in program.signals:
            position = rows[:, program.signals[source]]
            events += _Crossings(block, (times, {}, steps), position)
    return _Sorted(events, end, outcome)


def CompiledBends(run: CompiledRun, series: Series) -> tuple[list[str], list[str]]:
    """Returns what Outcome.find_bends tells of a compiled run.

    Args:
        series: The part of the run that is recorded.
    """
    times, _, steps = series
    _, rows = run.Rows()
    program = run.evaluator.program
    sent = {}
    for block, kernel in zip(run.evaluator.blocks, program.kernels, strict=True):
        for delay in kernel.delays:
            source = block.inputs.get(delay.signal)
            if delay.shown is None and source is not None:
                place = program.signals[source]
                sent[f"{block.path}.{delay.signal}"] = rows[: len(times), place]
    return Kinked(series), Kinked((times, sent, steps))


class Watched(NamedTuple):
    """What a run in Drake's Simulator records to find events.

    Attributes:
        guarded: The blocks with guards, by their paths.
        positions: The output port with the position at each block with surfaces, by the
            path of the block.
        sent: The output port with the signal of each delay, by its input
            `path.input`.
    """

    guarded: dict[str, Any]
    positions: dict[str, OutputPort]
    sent: dict[str, OutputPort]


def WatchedIn(system: System) -> Watched:
    """Returns what the events of a System's run depend on."""
    parts = SystemsByPath(system).values()
    if not any(hasattr(x, name) for x in parts for name in _WATCHED):
        return Watched({}, {}, {})
    blocks = Flatten(system)
    guarded = {x.path: x.system for x in blocks if getattr(x.system, "has_guards", 0)}
    positions = {}
    sent = {}
    for block in blocks:
        senders = {
            name: blocks[source.block].system.GetOutputPort(source.port)
            for name, source in block.inputs.items()
        }
        if _POSITION in senders and hasattr(block.system, "Surfaces"):
            positions[block.path] = senders[_POSITION]
        for line in getattr(block.system, "delays", ()):
            name = line.signal.get_name()
            if isinstance(line, DelayLine) and name in senders:
                sent[f"{block.path}.{name}"] = senders[name]
    return Watched(guarded, positions, sent)


def GuardsDue(guarded: Mapping[str, Any], root: Any, context: Context) -> list[Event]:
    """Returns an event for each guard that is 0 or more at the end of a step.

    Args:
        guarded: The blocks with guards, by their paths.
        root: The simulated System.
        context: Its Context.
    """
    contexts = ContextsIn(root, context)
    events = []
    for path, block in guarded.items():
        names = [name for name, (guard, _) in block.transitions.items() if guard]
        values = block.Guards(contexts[block])
        for name, value in zip(names, values, strict=True):
            if value >= 0:
                time = float(context.get_time())
                events.append(Event(name=f"{path}.{name}", time=time))
    return events


def DrakeEvents(
    job: Job, due: list[Event], positions: Mapping[str, Array], outcome: Outcome
) -> list[Event]:
    """Returns the events of a run in Drake's Simulator.

    Args:
        job: The specification of the run.
        due: The events of guards, from GuardsDue().
        positions: The samples of the positions of Watched, by the paths of the blocks.
        outcome: The outcome, with the part of the run that is recorded.
    """
    events = list(due)
    for block in Flatten(job.diagram):
        if block.path in positions:
            events += _Crossings(block, outcome.series, positions[block.path])
    return _Sorted(events, job.end, outcome)


def _Crossings(block: Any, series: Series, position: Array) -> Iterator[Event]:
    """Yields an event for each time at which a position passes a surface inwards."""
    times, _, steps = series
    pieces = Pieces(times, steps)
    surfaces = block.system.Surfaces() if hasattr(block.system, "Surfaces") else ()
    for surface in surfaces:
        depth = surface.Depth(position[: len(times)])
        signal = pieces.signal(depth[:, None])[..., 0]
        for time in pieces.crossings(signal).upwards:
            yield Event(name=f"{block.path}.{surface.name}", time=float(time))


def _Sorted(events: list[Event], end: float, outcome: Outcome) -> list[Event]:
    """Returns the events before the end of a run, in the order of time."""
    last = min(float(outcome.series[0][-1]), end - same_within(end))
    known = [Event(name=x.name, time=float(x.time)) for x in events if x.time <= last]
    return sorted(known, key=lambda event: event.time)
