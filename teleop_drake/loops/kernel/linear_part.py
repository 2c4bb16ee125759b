"""A block's contribution to the linear model of its loop.

A block without a method ForLinearModel() has continuous states only, all of which are
states of the model. Any other block has this method, which returns a LinearPart:

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        return LinearPart(num_states=0)

`estimates` is the state of an adaptive law at the operating point; None: its initial
state. Other blocks ignore it. The method raises a ScenarioError if the block has no
linear model.
"""

from dataclasses import dataclass
from typing import NamedTuple

from pydrake.systems.framework import System

from teleop_drake.loops.framework.arrays import Array

FROZEN_WEIGHTS = "frozen weights"
"""The estimates of an adaptive law are held constant."""

IDLE_PASSIVITY = "idle passivity"
"""Passivity controllers inject nothing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldForce:
    """The behaviour of an operator after it has perceived contact.

    Attributes:
        state: The discrete state of the block after contact.
        force: The force in N (n) that the operator holds.
    """

    state: Array
    force: Array


class Sampling(NamedTuple):
    """A block that samples its input and shows each sample later.

    Attributes:
        period: The time between two samples in s; the first one is taken at 0.
        delay: The time in s after which a sample is shown, > 0.
    """

    period: float
    delay: float


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPart:
    """A block's contribution to the linear model.

    Attributes:
        num_states: Number of continuous states, counted from the first, that are states
            of the model. The others are held constant. None: all are states.
        state: The initial continuous state; None: the state of the default Context.
        has_modes: Whether the discrete state selects one of several laws, and does not
            change near the operating point.
        held_force: The force that an operator holds after it has perceived contact.
            None: the block is not an operator, or the operator holds no force.
        delay: The constant time in s by which the block delays its first input, or, if
            the delay is an input as well, its largest value. None: the block is not a
            delay.
        sampling: The sampling and delay of the block; None: it does not sample, or not
            with one period and one delay.
        assumption: FROZEN_WEIGHTS or IDLE_PASSIVITY if the model rests on it.
    """

    num_states: int | None = None
    state: Array | None = None
    has_modes: bool = False
    held_force: HeldForce | None = None
    delay: float | None = None
    sampling: Sampling | None = None
    assumption: str = ""


def LinearPartOf(system: System, estimates: Array | None = None) -> LinearPart:
    """Returns the linear part that a block declares, or the default linear part.

    Args:
        estimates: State of an adaptive law; None: its initial one.

    Raises:
        ScenarioError: If the block has no linear model.
    """
    tell = getattr(system, "ForLinearModel", None)
    return LinearPart() if tell is None else tell(estimates)
