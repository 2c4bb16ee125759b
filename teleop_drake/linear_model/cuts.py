"""A diagram with its delays cut: states, delayed signals and fixed inputs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram, InputPort, System

from teleop_drake.kernel.linear_part import DelayBlock, HeldForce, LinearPartOf
from teleop_drake.validation import ScenarioError, Within

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """Continuous states of a system which the model has as its own."""

    system: System
    context: Context
    indices: NDArray[np.int_]

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


@dataclass(frozen=True, kw_only=True, eq=False)
class InnerDelay:
    """A delay inside of a station, cut open: what it delivers is set."""

    system: System
    context: Context
    delay: float

    @property
    def size(self) -> int:
        """Width of its signal."""
        return int(self.system.get_input_port().size())

    def Settle(self) -> None:
        """Lets it deliver what goes in now."""
        self.Set(self.system.get_input_port().Eval(self.context))

    def Get(self) -> Array:
        """Returns what it delivers now."""
        value: Array = self.system.get_output_port().Eval(self.context)
        return value

    def Set(self, value: Array) -> None:
        """Lets it deliver a value."""
        cast(DelayBlock, self.system).Deliver(self.context, value)


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
    if isinstance(system, Diagram) and not hasattr(system, "ForLinearModel"):
        for child in system.GetSystems():
            yield from Leaves(child)
    else:
        yield system


def FindHeldForce(system: System) -> tuple[System, HeldForce] | None:
    """Returns the operator that holds a force after contact, and what it tells.

    Returns:
        The block and its force; None: no block in it tells any.
    """
    for block in Leaves(system):
        held = LinearPartOf(block).held_force
        if held is not None:
            return block, held
    return None


@dataclass(frozen=True, kw_only=True, eq=False)
class CutPart:
    """A part of the loop, its states and what its blocks tell.

    Attributes:
        states: The continuous states that the model has.
        delays: Delays inside.
        assumptions: What the model takes for granted; see linear_part.
    """

    states: list[States]
    delays: list[InnerDelay]
    assumptions: set[str]


def CutOpen(
    system: System,
    contexts: Mapping[System, Context],
    *,
    estimates: Array | None = None,
    may_delay: bool = False,
) -> CutPart:
    """Finds the states of a part of the loop, and cuts the delays inside of it.

    Args:
        system: The part; its name goes before the fields that are refused.
        estimates: The state of an adaptive law in it; None: the initial one.
        may_delay: Whether there may be delays inside.

    Raises:
        ScenarioError: If a block has a state that is neither continuous nor a mode, or
            has no linear model.
    """
    part = CutPart(states=[], delays=[], assumptions=set())
    for block in Leaves(system):
        context = contexts[block]
        with Within(system.get_name()):
            told = LinearPartOf(block, estimates)
        is_cut = may_delay and told.delay is not None
        is_sampled = context.num_discrete_state_groups() > 0 and not told.has_modes
        if (is_sampled or context.num_abstract_states() > 0) and not is_cut:
            raise ScenarioError(
                f"{system.get_name()}.{block.get_name()} = a state that is not "
                "continuous: must be continuous for a linear model"
            )
        if is_cut and told.delay:
            part.delays.append(
                InnerDelay(system=block, context=context, delay=told.delay)
            )
        if told.assumption:
            part.assumptions.add(told.assumption)
        if told.state is not None:
            context.SetContinuousState(told.state)
        size = context.num_continuous_states()
        if told.num_states is not None:
            size = told.num_states
        if size:
            states = States(system=block, context=context, indices=np.arange(size))
            part.states.append(states)
    return part


def SetStates(states: Sequence[States], x: Array) -> None:
    """Splits a vector among the states, in their order."""
    begin = 0
    for part in states:
        part.Set(x[begin : begin + len(part.indices)])
        begin += len(part.indices)
