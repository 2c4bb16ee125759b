"""The Python functions behind Drake's callbacks, found while no line of them runs.

Drake is made to call a function while a profiler watches. The profiler raises an error
as the function begins, and the error leaves through Drake. CPython keeps the function
object in the frame, where gc.get_referents() finds it, with its closure.
"""

import contextlib
import gc
import inspect
import sys
from collections.abc import Callable, Iterator
from types import CodeType, FrameType, FunctionType
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    DiscreteUpdateEvent,
    DiscreteValues,
    PublishEvent,
    State,
    UnrestrictedUpdateEvent,
)

from teleop_drake.loops.jit.symbols import Untraceable

_NUMPY = np.__path__[0]


_OF_ONE_CALL = (
    AbstractValue, BasicVector, ContinuousState, DiscreteUpdateEvent, DiscreteValues,
    PublishEvent, State, UnrestrictedUpdateEvent,
)  # fmt: skip


class Passed(NamedTuple):
    """Stands for an object that Drake passes to a function in one call.

    The object itself must not be kept: Drake deletes it, and the next one at its place
    in memory would be taken for it.

    Attributes:
        kind: The class of the object.
    """

    kind: type


def IsPassed(value: Any, *kinds: type) -> bool:
    """Returns whether an argument is passed by Drake, and is of one of some classes."""
    return isinstance(value, Passed) and issubclass(value.kind, kinds)


class Found(NamedTuple):
    """A Python function as Drake calls it.

    Attributes:
        function: The function.
        arguments: Its arguments; Passed for those that belong to the call.
        keywords: Its keyword arguments.
    """

    function: FunctionType
    arguments: list[Any]
    keywords: dict[str, Any]

    @property
    def name(self) -> str:
        """The name of the function, for messages."""
        return f"{self.function.__name__}()"


class Stop(Exception):
    """Raised in the place of the first line of a callback."""


@contextlib.contextmanager
def Watched(note: Callable[[FrameType, str, Any], None]) -> Iterator[None]:
    """Calls a function at each call in Python; the garbage collector waits."""
    profiler: Any = sys.getprofile()  # A function, or an object such as cProfile's.
    has_collector = gc.isenabled()
    gc.disable()
    sys.setprofile(note)
    try:
        yield
    finally:
        sys.setprofile(None)
        if hasattr(profiler, "enable"):
            profiler.enable()
        else:
            sys.setprofile(profiler)
        if has_collector:
            gc.enable()


def IsCalledByDrake(frame: FrameType, event: str, caller: CodeType) -> bool:
    """Returns whether a profiler's event is a call by Drake, which has no frame.

    Args:
        caller: The code of the Python function that has called Drake.
    """
    before = frame.f_back
    if event != "call" or before is None or before.f_code is not caller:
        return False
    # nanobind copies results by functions of numpy that are written in Python.
    return not frame.f_code.co_filename.startswith(_NUMPY)


def FoundIn(frame: FrameType, context: Context) -> Found:
    """Returns the function of a frame that has ended, with its arguments.

    Args:
        frame: The frame, which is cleared.
        context: The Context with which Drake has called the function.
    """
    code = frame.f_code
    values = frame.f_locals
    names = code.co_varnames
    arguments = [values[name] for name in names[: code.co_argcount]]
    end = code.co_argcount + code.co_kwonlyargcount
    keywords = {name: values[name] for name in names[code.co_argcount : end]}
    if code.co_flags & inspect.CO_VARARGS:
        arguments += values[names[end]]
        end += 1
    if code.co_flags & inspect.CO_VARKEYWORDS:
        keywords |= values[names[end]]
    is_of_vectors = code.co_name.startswith("DoCalcVector")
    arguments = [_Kept(x, context, is_of_vectors) for x in arguments]
    functions = [x for x in gc.get_referents(frame) if isinstance(x, FunctionType)]
    del values
    frame.clear()
    _ = frame.f_locals  # Before CPython 3.13 this removes copies of the arguments.
    for function in functions:
        if function.__code__ is code:
            return Found(function, arguments, keywords)
    raise Untraceable(f"{code.co_qualname}() is not found")


def _Kept(value: Any, context: Context, is_of_vectors: bool) -> Any:
    """Returns an argument, or what stands for an object of the call."""
    is_of_call = value is context or isinstance(value, _OF_ONE_CALL)
    if is_of_call:
        return Passed(type(value))
    if is_of_vectors and isinstance(value, np.ndarray):
        return np.zeros(value.size)  # The array is a view of Drake's memory.
    return value


def FindCallback(call: Callable[[Context], Any], context: Context) -> Found | None:
    """Returns the first Python function that Drake calls in a call; None: none.

    Args:
        call: A Python function that calls Drake with a Context.
        context: The Context.
    """
    frames: list[FrameType] = []
    caller = call.__code__

    def Note(frame: FrameType, event: str, _: Any) -> None:
        if not frames and IsCalledByDrake(frame, event, caller):
            frames.append(frame)
            raise Stop

    with Watched(Note):
        try:
            call(context)
        except Stop:
            pass
        # Drake may wrap the error. What its C++ code demands raises SystemExit.
        except (Exception, SystemExit) as error:
            if not frames:
                reason = f"Drake cannot evaluate it: {error}".splitlines()[0]
                raise Untraceable(reason) from error
    return FoundIn(frames.pop(), context) if frames else None
