"""A block's contribution to the linear model of its loop.

A block without a method ForLinearModel() has continuous states only, all of which are
states of the model. Any other block has one, which returns a LinearPart:

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        return LinearPart(num_states=0)

`estimates` is the state that an adaptive law has at the operating point; None: the
initial one. Other blocks ignore it. A block that has no linear model refuses there.
"""

from dataclasses import dataclass

from pydrake.systems.framework import System

from teleop_drake.arrays import Array

FROZEN_WEIGHTS = "frozen weights"
"""The estimates of an adaptive law are held constant."""

IDLE_PASSIVITY = "idle passivity"
"""Passivity controllers inject nothing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldForce:
    """What an operator does once it has perceived contact.

    Attributes:
        state: The discrete state that the block has from then on.
        force: The force that it holds, in N (n).
    """

    state: Array
    force: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPart:
    """What is to be known of a block.

    Attributes:
        num_states: How many of the continuous states, the first ones, are states of
            the model. The others are held. None: all are.
        state: The continuous state to begin with; None: that of the default Context.
        has_modes: Whether the discrete state tells which of several laws holds, and
            stays what it is near the operating point.
        held_force: Of an operator that holds a force once it has perceived contact.
            None: it does not, or it is no operator.
        delay: Of a block that delays its input by a constant time, s; None: it is no
            delay.
        assumption: FROZEN_WEIGHTS or IDLE_PASSIVITY, if the model takes that for
            granted.
    """

    num_states: int | None = None
    state: Array | None = None
    has_modes: bool = False
    held_force: HeldForce | None = None
    delay: float | None = None
    assumption: str = ""


def LinearPartOf(system: System, estimates: Array | None = None) -> LinearPart:
    """Returns what a block tells, or what holds for one that tells nothing.

    Args:
        estimates: State of an adaptive law; None: its initial one.

    Raises:
        ScenarioError: If the block has no linear model.
    """
    tell = getattr(system, "ForLinearModel", None)
    part: LinearPart = LinearPart() if tell is None else tell(estimates)
    return part
