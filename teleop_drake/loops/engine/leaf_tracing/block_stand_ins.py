"""Stand-ins for a block in a function of it that is followed, and for its parts."""

import functools
import sys
from types import FunctionType
from typing import Any, NoReturn

from pydrake.systems.framework import Context, InputPort, OutputPort

from teleop_drake.loops.engine.leaf_tracing.stand_ins import (
    Continuous,
    Groups,
    StandIn,
    Vector,
)
from teleop_drake.loops.jit.following import Follow
from teleop_drake.loops.jit.symbols import Untraceable

# Methods of a LeafSystem that return the same in each call.
_CONSTANT = (
    "num_input_ports", "num_output_ports", "num_continuous_states", "get_name",
    "GetSystemName", "GetSystemType",
)  # fmt: skip


class OwnContext(StandIn):
    """The block's Context."""

    what = "context"
    kind = Context

    def __init__(self, reader: Any):
        self._reader = reader

    def get_time(self) -> Any:
        return self._reader.Load("time")[0]

    def get_continuous_state(self) -> Any:
        reader = self._reader
        state = reader.context.get_continuous_state()
        return Continuous(reader.Load("state"), state)

    def get_continuous_state_vector(self) -> Any:
        return self.get_continuous_state().get_vector()

    # Some people read by these; what they return refuses to be written.
    get_mutable_continuous_state = get_continuous_state
    get_mutable_continuous_state_vector = get_continuous_state_vector

    def get_discrete_state(self, *index: Any) -> Any:
        reader = self._reader
        groups = Groups(reader.Load("mode"), reader.groups, Vector)
        return groups.get_vector(*index) if index else groups

    def get_discrete_state_vector(self) -> Any:
        return self.get_discrete_state(0)

    get_mutable_discrete_state = get_discrete_state
    get_mutable_discrete_state_vector = get_discrete_state_vector

    def get_numeric_parameter(self, index: Any) -> Any:
        return Vector(self._reader.Load(f"parameter{int(index)}"))

    def get_state(self) -> Any:
        return self

    def num_continuous_states(self) -> int:
        return int(self._reader.num_states)

    def num_input_ports(self) -> int:
        return int(self._reader.system.num_input_ports())


class OwnInput(StandIn):
    """An input port of the block."""

    what = "an input port"
    kind = InputPort

    def __init__(self, reader: Any, port: Any):
        self._reader = reader
        self._port = port

    def Eval(self, context: Any) -> Any:
        _CheckContext(context)
        return self._reader.Input(self._port)

    def EvalBasicVector(self, context: Any) -> Any:
        return Vector(self.Eval(context))

    def HasValue(self, context: Any) -> bool:
        _CheckContext(context)
        return bool(self._port.HasValue(self._reader.context))

    def size(self) -> int:
        return int(self._port.size())

    def get_index(self) -> int:
        return int(self._port.get_index())

    def get_name(self) -> str:
        return str(self._port.get_name())


class OwnOutput(OwnInput):
    """An output port of the block."""

    what = "an output port"
    kind = OutputPort

    def Eval(self, context: Any) -> Any:
        _CheckContext(context)
        return self._reader.Inline(self._port)


class OwnCache(StandIn):
    """A cache entry of the block."""

    what = "a cache entry"

    def __init__(self, reader: Any, entry: Any):
        self._reader = reader
        self._entry = entry

    def Eval(self, context: Any) -> Any:
        _CheckContext(context)
        return self._reader.InlineCache(self._entry)


class OwnMeshcat(StandIn):
    """A Meshcat whose sliders the block reads, which keep their values in a run."""

    what = "meshcat"

    def __init__(self, reader: Any, meshcat: Any):
        self._reader = reader
        self._meshcat = meshcat

    def GetSliderValue(self, name: str) -> Any:
        return self._reader.Slider(self._meshcat, name)


def _CheckContext(context: Any) -> None:
    if type(context) is not OwnContext:
        raise Untraceable("it evaluates a port in another Context")


class OwnBlock:
    """The block: its attributes are followed, and none is assigned."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, reader: Any):
        object.__setattr__(self, "_reader", reader)

    def __getattribute__(self, name: str) -> Any:
        reader = object.__getattribute__(self, "_reader")
        return _AttributeOf(reader, self, name)

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise Untraceable(f"it assigns to self.{name}")

    def __eq__(self, other: Any) -> NoReturn:
        raise Untraceable("it compares self")


class SuperOf:
    """What super() returns: the methods of the classes behind a class of the block.

    Args:
        reader: The reader of the block.
        me: The stand-in for the block.
        cls: The class whose method is followed.
    """

    def __init__(self, reader: Any, me: OwnBlock, cls: type):
        self._found = reader, me, cls

    def __getattr__(self, name: str) -> Any:
        reader, me, cls = self._found
        classes = type(reader.system).__mro__
        for base in classes[classes.index(cls) + 1 :]:
            if isinstance(vars(base).get(name), FunctionType):
                function = Follow(reader.graph, vars(base)[name], name)
                return functools.partial(function, me)
        return _AttributeOf(reader, me, name)


def SuperIn(*arguments: Any) -> SuperOf:
    """Returns what super() returns in a method of a block."""
    cls, me = arguments or (None, None)
    if not arguments:
        frame = sys._getframe(1)
        cls = frame.f_locals["__class__"]
        me = frame.f_locals[frame.f_code.co_varnames[0]]
    if type(me) is not OwnBlock:
        raise Untraceable("it calls super() of another object")
    reader = object.__getattribute__(me, "_reader")
    return SuperOf(reader, me, object.__getattribute__(cls, "_outside")[1])


def _AttributeOf(reader: Any, me: OwnBlock, name: str) -> Any:
    """Returns what replaces an attribute of the block."""
    system = reader.system
    if name == "__class__":
        return type(system)
    if name in _METHODS:
        return functools.partial(_METHODS[name], reader)
    follow = functools.partial(Follow, reader.graph)
    raw = _Raw(type(system), name)
    if isinstance(raw, property) and raw.fget:
        return follow(raw.fget, name)(me)
    if name in vars(system):
        return follow(vars(system)[name], f"self.{name}")
    if isinstance(raw, functools.cached_property):
        return follow(raw.func, name)(me)
    if isinstance(raw, FunctionType):
        return functools.partial(follow(raw, name), me)
    if name in _CONSTANT:
        return getattr(system, name)
    if type(raw).__name__ in ("instancemethod", "nb_func", "nb_method"):
        raise Untraceable(f"a call of self.{name}()")
    return follow(getattr(system, name), f"self.{name}")


def _Raw(cls: type, name: str) -> Any:
    """Returns an attribute as a class defines it; None if there is none."""
    for base in cls.__mro__:
        if name in vars(base):
            return vars(base)[name]
    return None


def _InputAt(reader: Any, index: Any = 0) -> Any:
    return reader.Port(reader.system.get_input_port(int(index)))


def _EvalVectorInput(reader: Any, context: Any, index: Any) -> Any:
    port = _InputAt(reader, index)
    return port.EvalBasicVector(context) if port.HasValue(context) else None


_METHODS: dict[str, Any] = {
    "get_input_port": _InputAt,
    "GetInputPort": lambda reader, name: reader.Port(reader.system.GetInputPort(name)),
    "get_output_port": lambda reader, index=0: reader.Port(
        reader.system.get_output_port(int(index))
    ),
    "GetOutputPort": lambda reader, name: reader.Port(
        reader.system.GetOutputPort(name)
    ),
    "EvalVectorInput": _EvalVectorInput,
    "get_cache_entry": lambda reader, index: OwnCache(
        reader, reader.system.get_cache_entry(index)
    ),
    "ValidateContext": lambda reader, context: _CheckContext(context),
}
