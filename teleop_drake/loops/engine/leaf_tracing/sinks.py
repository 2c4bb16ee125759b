"""Users' blocks in Python on which nothing depends, such as logs and visualizers."""

import dis
import math
from collections.abc import Iterator
from types import CodeType, FrameType, FunctionType
from typing import Any

from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import DiscreteValues, LeafSystem, State

from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.leaf_tracing.callbacks import (
    Found,
    FoundIn,
    IsCalledByDrake,
    IsPassed,
    Stop,
    Watched,
)

_ENDS = {"ReachedTermination", "Failed"}

# At so many instants, the first handler is looked for.
_NUM_INSTANTS = 30


def CheckSink(system: Any) -> None:
    """Refuses a block that cannot be left out, because it may do more than publish.

    Its handlers are found, and no line of them runs.

    Raises:
        UnsupportedSystem: If an event updates a state, if a handler is no method of the
            block's class, or if the class has code that may end a run: it returns a
            status that does, or raises an error.
    """
    codes = [code for _, code in _CodesOf(type(system))]
    for found in _HandlersOf(system):
        updates = any(IsPassed(x, DiscreteValues, State) for x in found.arguments)
        if updates or found.function.__code__ not in codes:
            reason = f"its event {found.name} may do more than publish"
            raise UnsupportedSystem(system, reason)
    for is_harmless, code in _CodesOf(type(system)):
        raises = any(x.opname == "RAISE_VARARGS" for x in dis.get_instructions(code))
        if MayEnd(code) or (raises and not is_harmless):
            reason = f"{code.co_name}(), line {code.co_firstlineno}, may end a run"
            raise UnsupportedSystem(system, reason)


def MayEnd(code: CodeType) -> bool:
    """Returns whether code, or a function that it defines, returns a status of an end.

    Drake ends a run at such a status.
    """
    codes = [code, *_InnerCodes(code)]
    return any(_ENDS & set(each.co_names) for each in codes)


def _CodesOf(cls: type) -> Iterator[tuple[bool, CodeType]]:
    """Yields the code of a user's class, and whether what it raises ends no run.

    That is the code of constructors, and of classes of Drake's in Python.
    """
    for base in cls.__mro__[: cls.__mro__.index(LeafSystem)]:
        is_of_drake = base.__module__.startswith("pydrake")
        for name, method in vars(base).items():
            function = getattr(method, "__func__", method)
            if isinstance(function, FunctionType):
                yield is_of_drake or name == "__init__", function.__code__
                for inner in _InnerCodes(function.__code__):
                    yield is_of_drake, inner


def _InnerCodes(code: CodeType) -> Iterator[CodeType]:
    """Yields the code of the functions that are defined inside of a function."""
    for item in code.co_consts:
        if isinstance(item, CodeType):
            yield item
            yield from _InnerCodes(item)


def _Advance(simulator: Simulator, parameters: InitializeParams) -> None:
    simulator.Initialize(parameters)
    simulator.AdvanceTo(simulator.get_context().get_time() + 1e9)


def _HandlersOf(system: Any) -> Iterator[Found]:
    """Yields the first handler that Drake calls at each of some instants."""
    context = system.CreateDefaultContext()
    simulator = Simulator(system, context)
    parameters = InitializeParams(suppress_initialization_events=True)
    for _ in range(_NUM_INSTANTS):
        frames: list[FrameType] = []

        def Note(frame: FrameType, event: str, _: Any, frames: Any = frames) -> None:
            if not frames and IsCalledByDrake(frame, event, _Advance.__code__):
                frames.append(frame)
                raise Stop

        with Watched(Note):
            try:
                _Advance(simulator, parameters)
            except (Exception, SystemExit) as error:
                if not frames:
                    reason = f"its events cannot be determined: {error}"
                    raise UnsupportedSystem(system, reason) from error
        if not frames:
            return
        yield FoundIn(frames.pop(), context)
        context.SetTime(math.nextafter(context.get_time(), math.inf))
