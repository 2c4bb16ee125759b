"""Stand-ins for Drake's objects in a function that is followed.

Each has the methods of the object that read, or write, numbers; these are Numbers of a
graph. It refuses everything else.
"""

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from pydrake.common.containers import NamedViewBase
from pydrake.systems.framework import (
    BasicVector,
    ContinuousState,
    DiscreteValues,
    State,
)

from teleop_drake.loops.jit.symbolic_arrays import AsFloats, AsNumbers, Objects
from teleop_drake.loops.jit.symbols import Untraceable


class StandIn:
    """Refuses everything that a subclass does not define.

    Attributes:
        what: What it stands for, for messages.
        kind: The class of Drake that it is an instance of, for isinstance().
    """

    what = "an object of Drake"
    kind: Any = object
    __hash__ = None  # type: ignore[assignment]

    @property  # type: ignore[misc]
    def __class__(self) -> Any:
        """The class of Drake."""
        return object.__getattribute__(self, "kind")

    def __getattr__(self, name: str) -> NoReturn:
        raise Untraceable(f"it uses {self.what}.{name}")

    def __eq__(self, other: Any) -> NoReturn:
        raise Untraceable(f"it compares {self.what}")


def Copied(values: Any) -> Any:
    """Returns a copy of an array, into which Numbers can be written."""
    return AsNumbers(np.array(values, object))


class Vector(StandIn):
    """A vector that is read: a state, an input, a parameter."""

    what = "a vector"
    kind = BasicVector

    def __init__(self, values: Any):
        self.values = values

    def CopyToVector(self) -> Any:
        return Copied(self.values)

    value = get_value = CopyToVector

    def GetAtIndex(self, index: Any) -> Any:
        return self.values[index if isinstance(index, slice) else int(index)]

    __getitem__ = GetAtIndex

    def size(self) -> int:
        return len(self.values)

    __len__ = size


class Result(Vector):
    """A vector that is written; an element that is not written is None."""

    what = "a result"

    def CopyToVector(self) -> Any:
        if any(x is None for x in self.values):
            raise Untraceable("it reads a result that it has not written")
        return Copied(self.values)

    value = get_value = CopyToVector

    def GetAtIndex(self, index: Any) -> Any:
        return self.CopyToVector()[index if isinstance(index, slice) else int(index)]

    __getitem__ = GetAtIndex

    def SetFromVector(self, value: Any) -> None:
        if isinstance(value, NamedViewBase):
            value = value[:]
        vector = AsFloats(Objects(value)).ravel()
        if len(vector) != len(self.values):
            raise Untraceable(f"{len(vector)} elements instead of {len(self.values)}")
        self.values[:] = vector

    set_value = SetFromVector

    def SetFrom(self, other: Any) -> None:
        self.SetFromVector(other.CopyToVector())

    def SetAtIndex(self, index: Any, value: Any) -> None:
        if isinstance(index, slice):
            self.values[index] = AsFloats(Objects(value))
            return
        if isinstance(value, np.ndarray):
            value = value.item()
        self.values[int(index)] = AsFloats(Objects(value)).item()

    __setitem__ = SetAtIndex

    def SetZero(self) -> None:
        self.values[:] = 0.0

    def get_mutable_value(self) -> Any:
        return self.values

    def get_mutable_vector(self) -> Any:
        return self


class Continuous(Vector):
    """The continuous state, which is read.

    Args:
        values: Its elements.
        state: Drake's ContinuousState, which has the sizes of its parts.
    """

    what = "the continuous state"
    kind = ContinuousState
    part: Any = Vector

    def __init__(self, values: Any, state: Any):
        super().__init__(values)
        self._ends = state.num_q(), state.num_q() + state.num_v()

    def get_vector(self) -> Any:
        return self.part(self.values)

    get_mutable_vector = get_vector

    def get_generalized_position(self) -> Any:
        return self.part(self.values[: self._ends[0]])

    def get_generalized_velocity(self) -> Any:
        return self.part(self.values[self._ends[0] : self._ends[1]])

    def get_misc_continuous_state(self) -> Any:
        return self.part(self.values[self._ends[1] :])


class Rates(Continuous, Result):
    """The time derivatives of the continuous state, which are written."""

    what = "the derivatives"
    part = Result
    CopyToVector = Result.CopyToVector
    value = get_value = CopyToVector
    GetAtIndex = __getitem__ = Result.GetAtIndex
    get_mutable_vector = Continuous.get_vector
    get_mutable_generalized_position = Continuous.get_generalized_position
    get_mutable_generalized_velocity = Continuous.get_generalized_velocity
    get_mutable_misc_continuous_state = Continuous.get_misc_continuous_state


class Groups(StandIn):
    """The discrete state, whose groups are read or, as Results, written.

    Args:
        values: The elements of all groups.
        slices: The place of each group.
        part: The class of the groups' stand-ins.
    """

    what = "the discrete state"
    kind = DiscreteValues

    def __init__(self, values: Any, slices: Sequence[slice], part: Any):
        self._groups = [part(values[group]) for group in slices]

    def get_vector(self, index: Any = 0) -> Any:
        return self._groups[int(index)]

    get_mutable_vector = get_vector

    def value(self, index: Any = 0) -> Any:
        return self.get_vector(index).CopyToVector()

    get_value = value

    def get_mutable_value(self, index: Any = 0) -> Any:
        return self.get_vector(index).get_mutable_value()

    def set_value(self, *arguments: Any) -> None:
        *index, value = arguments
        self.get_vector(*index).SetFromVector(value)

    def num_groups(self) -> int:
        return len(self._groups)

    def size(self) -> int:
        return int(self.get_vector().size())

    def __getitem__(self, index: Any) -> Any:
        return self.get_vector()[index]

    def __setitem__(self, index: Any, value: Any) -> None:
        self.get_vector()[index] = value


class WrittenState(StandIn):
    """The state that an unrestricted update writes; only discrete states change.

    Args:
        groups: The stand-in for the discrete state.
    """

    what = "the state"
    kind = State

    def __init__(self, groups: Groups):
        self._groups = groups

    def get_mutable_discrete_state(self, *index: Any) -> Any:
        return self._groups.get_vector(*index) if index else self._groups

    get_discrete_state = get_mutable_discrete_state

    def get_mutable_continuous_state(self) -> NoReturn:
        raise Untraceable("its event changes the continuous state")


class Cell(StandIn):
    """An abstract value that a cache entry writes."""

    what = "an abstract value"

    def __init__(self) -> None:
        self.written: Any = None

    def set_value(self, value: Any) -> None:
        self.written = value

    def get_mutable_value(self) -> NoReturn:
        raise Untraceable("it changes an abstract value: write set_value()")


class Status(StandIn):
    """An EventStatus: that the event has changed the state, or has done nothing."""

    what = "an event status"

    def __init__(self, *, has_changed: bool):
        self.has_changed = has_changed


class StatusClass(StandIn):
    """The class EventStatus."""

    what = "EventStatus"

    @staticmethod
    def Succeeded() -> Status:
        return Status(has_changed=True)

    @staticmethod
    def DidNothing() -> Status:
        return Status(has_changed=False)

    @staticmethod
    def ReachedTermination(*_: Any) -> NoReturn:
        raise Untraceable("it may end the run")

    Failed = ReachedTermination
