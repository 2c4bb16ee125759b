"""The base class of the delays' blocks, and what delays they may have."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.loops.kernel import Delay, FixedBlock, Kernel

SHORTEST_TIME = 1e-6
"""Shortest non-zero delay and sample period in s. No step of a simulation is longer
than these times, so a run with shorter ones would practically never end."""

MAX_PACKETS = 100_000
"""Largest number of packets that may be under way in a channel."""


def CheckDelay(path: str, delay: float) -> None:
    """Refuses a delay in s that is neither 0 nor at least SHORTEST_TIME."""
    if delay != 0 and not SHORTEST_TIME <= delay < math.inf:
        Refuse(path, delay, f"0 or a finite number >= {SHORTEST_TIME:g} (s)")


def CheckSize(size: Any) -> None:
    """Refuses a width of a signal that is not a whole number >= 1."""
    if isinstance(size, AbstractValue):
        allowed = "the width of a vector; AbstractDelay delays other values"
        Refuse("size", f"a Value of {type(size.get_value()).__name__}", allowed)
    if not isinstance(size, int | np.integer) or size < 1:
        Refuse("size", size, "a whole number >= 1")


def CheckedInterval(max_sample_interval: float | None) -> float:
    """Returns the longest time in s between two samples of a delay that is a signal.

    Raises:
        ScenarioError: If it is not > 0 and finite.
    """
    if max_sample_interval is None:
        return 0.01
    CheckNumber("max_sample_interval", max_sample_interval, "s", above=0)
    return max_sample_interval


class ChannelBlock(FixedBlock):
    """Base of the channels' blocks, which deliver a vector signal later.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    Attributes:
        initial_value: The output before the first sample arrives (size).
        notes: What a recording should tell of it, such as what was read from a file.

    Args:
        delay: The delay in s, finite and >= 0.
        size: Width of the signal, >= 1.
        initial_value: The output before the first sample arrives (size); zeros if None.

    Raises:
        ScenarioError: If an argument is not allowed.
    """

    def __init__(self, delay: float, size: int, initial_value: Sequence[float] | None):
        CheckNumber("delay", delay, "s", minimum=0)
        CheckSize(size)
        if initial_value is not None and len(initial_value) != size:
            Refuse("initial_value", initial_value, f"{size} numbers or null")
        self.initial_value = [0.0] * size if initial_value is None else initial_value
        self.notes: list[str] = []

    def RunNotes(self, time: Array, signals: Mapping[str, Array]) -> list[str]:
        """Returns the notes for the recording of a run."""
        return [f"{self.get_name()}: {note}" for note in self.notes]

    def DeclarePassThrough(self) -> None:
        """Declares the ports of a block whose output is the signal itself."""
        self._Declare(Kernel(outputs={"delayed_signal": "signal"}))

    def DeclareDelay(self, **line: Any) -> None:
        """Declares the ports of a block whose output is the delayed signal.

        Args:
            line: Further fields of the Delay from `signal` to `delayed_signal`.
        """
        delay = Delay(
            signal="signal",
            output="delayed_signal",
            initial_value=self.initial_value,
            **line,
        )
        self._Declare(Kernel(delays=[delay]))

    def _Declare(self, kernel: Kernel) -> None:
        size = len(self.initial_value)
        inputs = {"signal": size}
        inputs |= {x.time: 1 for x in kernel.delays if isinstance(x.time, str)}
        outputs = {"delayed_signal": size}
        FixedBlock.__init__(self, "", kernel, inputs=inputs, outputs=outputs)
