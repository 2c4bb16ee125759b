"""What the linearizer holds of a diagram: states, cut delays and fixed inputs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram, InputPort, System

from teleop_drake.architectures.adaptive_backstepping import AdaptiveBackstepping
from teleop_drake.channels.transport import TransportDelay
from teleop_drake.numerics.sample_history import SampleHistory

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """Continuous states of a system which the model has as its own."""

    system: System
    context: Context
    indices: Array

    def Get(self) -> Array:
        """Returns their values."""
        state = self.context.get_continuous_state_vector()
        values: Array = state.CopyToVector()[self.indices]
        return values

    def Set(self, values: Array) -> None:
        """Gives them values."""
        x = self.context.get_continuous_state_vector().CopyToVector()
        x[self.indices] = values
        self.context.SetContinuousState(x)

    def GetRates(self) -> Array:
        """Returns their time derivatives."""
        rates = self.system.EvalTimeDerivatives(self.context)
        values: Array = rates.CopyToVector()[self.indices]
        return values


class InnerDelay:
    """A TransportDelay inside a station, cut open: what it delivers is set."""

    def __init__(self, system: TransportDelay, context: Context):
        self.delay = system.delay
        self.size = system.get_input_port().size()
        self._system, self._context = system, context

    def GetInput(self) -> Array:
        """Returns what goes into the delay now."""
        value: Array = self._system.get_input_port().Eval(self._context)
        return value

    def Get(self) -> Array:
        """Returns what it delivers now."""
        value: Array = self._system.get_output_port().Eval(self._context)
        return value

    def Set(self, value: Array) -> None:
        """Lets it deliver a value."""
        # A history of a single sample, which arrives now.
        time = self._context.get_time()
        history = SampleHistory(times=(time,), values=np.array([value]), now=time)
        self._context.SetAbstractState(0, history)


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedInput:
    """Input ports whose value, one for all, takes the place of what is connected."""

    ports: list[InputPort]
    contexts: list[Context]

    def Get(self) -> Array:
        """Returns the value at the ports."""
        value: Array = self.ports[0].Eval(self.contexts[0])
        return value

    def Set(self, value: Array) -> None:
        """Fixes the ports at a value."""
        for port, context in zip(self.ports, self.contexts, strict=True):
            port.FixValue(context, value)


def Leaves(system: System) -> Iterator[System]:
    """Yields the systems whose states are told apart."""
    if isinstance(system, Diagram) and not isinstance(system, AdaptiveBackstepping):
        for child in system.GetSystems():
            yield from Leaves(child)
    else:
        yield system


def Concatenate(parts: Sequence[Array]) -> Array:
    """Returns the parts, none perhaps, as one vector."""
    return np.concatenate([np.zeros(0), *parts])


def SetStates(states: Sequence[States], x: Array) -> None:
    """Splits a vector among the states, in their order."""
    begin = 0
    for part in states:
        part.Set(x[begin : begin + len(part.indices)])
        begin += len(part.indices)
