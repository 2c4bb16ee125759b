"""The states of a linear model: those of blocks of a diagram."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Context, System

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import DiscreteState, SetDiscreteState
from teleop_drake.loops.linear.dual_diagram import Twin
from teleop_drake.loops.numerics.sample_schedule import Clock

Twins = Mapping[System, Twin]


@dataclass(frozen=True, eq=False)
class States:
    """The first continuous states of a block, which are states of a model.

    Attributes:
        system: The block.
        context: The block's Context.
        size: The number of these states.
    """

    system: System
    context: Context
    size: int

    def Get(self) -> Array:
        """Returns the values of the states."""
        state = self.context.get_continuous_state_vector()
        return state.CopyToVector()[: self.size]

    def Set(self, values: Array) -> None:
        """Sets the values of the states."""
        self.SetIn({self.system: Twin(self.system, self.context)}, values)

    def SetIn(self, twins: Twins, values: Array) -> None:
        """Sets the values of the states in a diagram of any scalar type."""
        context = twins[self.system].context
        x = context.get_continuous_state_vector().CopyToVector()
        x[: self.size] = values
        context.SetContinuousState(x)

    def NextIn(self, twins: Twins) -> Array:
        """Returns the rates of the states in a diagram of any scalar type."""
        system, context = twins[self.system]
        rates = system.EvalTimeDerivatives(context).CopyToVector()
        return np.asarray(rates[: self.size])


@dataclass(frozen=True, eq=False)
class HeldStates:
    """The discrete states of a block with one periodic update.

    Attributes:
        system: The block.
        context: The block's Context.
        size: The number of these states.
        clock: The instants of the update.
    """

    system: System
    context: Context
    size: int
    clock: Clock

    def Get(self) -> Array:
        """Returns the values of the states."""
        return DiscreteState(self.context)

    def SetIn(self, twins: Twins, values: Array) -> None:
        """Sets the values of the states in a diagram of any scalar type."""
        SetDiscreteState(twins[self.system].context, values)

    def NextIn(self, twins: Twins) -> Array:
        """Returns the values after an update in a diagram of any scalar type."""
        system, context = twins[self.system]
        new = system.EvalUniquePeriodicDiscreteUpdate(context)
        return np.concatenate([new.value(i) for i in range(new.num_groups())])
