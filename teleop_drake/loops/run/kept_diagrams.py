"""The programs of Diagrams that simulate() has compiled, for its next call.

They are kept for Diagrams of this package's blocks and of those blocks of Drake's that
cannot change after their construction. A program is kept without its systems, and only
as long as its Diagram exists. It is used again if the numbers in the Context, the
recorded signals and everything else that it was made from are the same.
"""

from collections.abc import Hashable, Mapping
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from pydrake.systems.framework import Context, Diagram, System

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.known_programs import IsOfPackage
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.framework.signals import SystemsByPath
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.jit.native import Packed
from teleop_drake.loops.kernel import KernelBlock
from teleop_drake.loops.run.compiled_run import CompiledDiagram, StartingAt, StartOf
from teleop_drake.loops.run.run import Job

# Modules of Drake whose systems are kept, without those that can change: Drake lets the
# trajectory of a source be replaced.
_MODULES = ("pydrake.systems.primitives", "pydrake.examples")
_CHANGING = ("TrajectorySource",)

# Some versions of Drake never free a Diagram with a block in Python.
_MOST_KEPT = 64


class _Kept(NamedTuple):
    """A program without its systems.

    Attributes:
        key: What the program was made from, see _KeyOf().
        evaluator: The evaluator, detached from its systems.
        places: As in CompiledDiagram.
        problems: As in CompiledDiagram, by the time of the start.
    """

    key: Hashable
    evaluator: Evaluator
    places: dict[str, slice]
    problems: dict[float, dict[float, Packed]]


_KEPT: WeakKeyDictionary[System, _Kept] = WeakKeyDictionary()


def KeptDiagram(job: Job) -> CompiledDiagram | None:
    """Returns the compiled diagram of a run if its program is known; else None."""
    kept = _KEPT.get(job.diagram)
    if kept is None:
        return None
    systems = SystemsByPath(job.diagram)
    if kept.key != _KeyOf(job, systems):
        return None
    start = StartOf(
        job.diagram,
        job.context,
        suppress_initialization_events=job.suppress_initialization_events,
    )
    try:
        evaluator = kept.evaluator.AttachedTo(job.diagram, start)
    except UnsupportedSystem:
        return None  # Somebody has added an event to a block of Drake's.
    compiled = StartingAt(start, job.diagram, evaluator, job.signals, kept.places)
    compiled.systems = systems
    if compiled.past is None:
        if compiled.start.t not in kept.problems:
            kept.problems.clear()
        compiled.problems = kept.problems.setdefault(compiled.start.t, {})
    return compiled


def Keep(job: Job, compiled: CompiledDiagram) -> None:
    """Keeps the program of a run, if it has no code of a user's and nothing changes."""
    key = _KeyOf(job, compiled.systems)
    evaluator = compiled.evaluator
    if key is None or not all(map(IsOfPackage, evaluator.program.laws)):
        return
    while len(_KEPT) >= _MOST_KEPT:
        _KEPT.pop(next(iter(_KEPT)), None)
    _KEPT[job.diagram] = _Kept(key, evaluator.Detached(), compiled.places, {})


def _KeyOf(job: Job, systems: Mapping[str, System]) -> Hashable | None:
    """Returns what the program of a run is made from; None if it cannot be told.

    Args:
        systems: The systems of the model by their paths.
    """
    if not all(map(_IsKnown, systems.values())):
        return None
    paths = {system: path for path, system in systems.items()}
    signals = [
        (name, paths[port.get_system()], int(port.get_index()))
        for name, port in job.signals.items()
    ]
    contexts = ContextsIn(job.diagram, job.context)
    inputs = [
        port.HasValue(own) for x, own in contexts.items() for port in InputPorts(x)
    ]
    return (
        tuple(systems),
        tuple(signals),
        tuple(inputs),
        _Numbers(job.context),
        (job.config.integration_scheme, job.config.use_error_control),
        job.suppress_initialization_events,
    )


def _Numbers(context: Context) -> tuple[bytes, ...]:
    """Returns the numeric parameters of a Context of a System and its parts."""
    parameters = context.get_parameters()
    groups = map(
        parameters.get_numeric_parameter,
        range(parameters.num_numeric_parameter_groups()),
    )
    return tuple(group.CopyToVector().tobytes() for group in groups)


def _IsKnown(system: Any) -> bool:
    """Returns whether a system is of Drake or this package, and does not change."""
    kind = type(system)
    if kind.__module__.partition(".")[0] == "teleop_drake":
        return isinstance(system, KernelBlock | Diagram)
    if kind is Diagram:
        return True
    return kind.__module__ in _MODULES and kind.__name__ not in _CHANGING
