"""Base of the configs of channels."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.arrays import Array, ArrayLike
from teleop_drake.kernel import Delay, FixedBlock, Kernel
from teleop_drake.kinds import KindConfig
from teleop_drake.validation import CheckNumber, Config, Refuse

SHORTEST_TIME = 1e-6
"""Shortest non-zero delay and sample period in s. The simulation steps at least as
often, and would never end."""


def CheckDelay(path: str, delay: float) -> None:
    """Refuses a delay in s that is neither 0 nor at least SHORTEST_TIME."""
    if delay != 0 and not SHORTEST_TIME <= delay < math.inf:
        Refuse(path, delay, f"0 or a finite number >= {SHORTEST_TIME:g} (s)")


@dataclass(frozen=True, kw_only=True)
class ConstantDelay:
    """A constant delay in the place of a channel.

    Attributes:
        delay: In s.
        note: A sentence that says what it stands for; None: for itself.
    """

    delay: float
    note: str | None = None


@Config
class ChannelConfig(KindConfig, ABC):
    """One direction of the communication (thesis section 2.1, Fig. 2.1).

    A channel of your own derives from this class, adds its fields, and makes its block
    in MakeChannel. It can be named in a scenario: `kind: my_module:MyChannel`.

    Attributes:
        draws_random_numbers: Whether runs with other seeds differ.
        has_packet_statistics: Whether its block has a method Statistics(context), which
            returns PacketStatistics.
    """

    draws_random_numbers: ClassVar[bool] = False
    has_packet_statistics: ClassVar[bool] = False

    # Delay, s, >= 0. Kinds whose delay varies add to it. Default: thesis section 4.2.
    delay: float = 0.1
    # Seed of the random numbers, a whole number >= 0. With one seed the two directions
    # still have different numbers. Without effect where none are drawn.
    seed: int = 0

    def Check(self, path: str, duration: float) -> None:
        """Checks every field.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: How long the simulation lasts, s.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        CheckDelay(f"{path}.delay", self.delay)
        if self.seed < 0:
            Refuse(f"{path}.seed", self.seed, "a whole number >= 0")

    @abstractmethod
    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> System:
        """Makes the block: input `signal`, output `delayed_signal` (size each).

        Args:
            initial_value: What arrives before the first packet does (size).
            duration: How long the simulation lasts, s.
            stream: Name of the random numbers; another one gives other numbers.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def LongestStep(self, duration: float) -> float:
        """Returns the longest step in s that the solver may take, infinity if any.

        Args:
            duration: How long the simulation lasts, s.
        """
        return math.inf

    def PacketPeriod(self) -> float:
        """Returns the time in s between packets, infinity if there are none.

        The solver stops at each of them.
        """
        return math.inf

    def IsPassThrough(self) -> bool:
        """Returns whether the signal comes out at the instant at which it goes in."""
        return False

    def LargestSlope(self, duration: float) -> float:
        """Returns an upper bound of dT/dt of the delay T.

        Args:
            duration: How long the simulation lasts, s.
        """
        return 0.0

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the constant delay with which a linear analysis replaces the channel.

        Here the field `delay`, which is right for a delay that is constant and exact.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: How long the simulation lasts, s.

        Raises:
            ScenarioError: If the channel is no delay.
        """
        return ConstantDelay(delay=self.delay)

    def Arrivals(self, sent: ArrayLike, duration: float, stream: str = "") -> Array:
        """Returns when what is sent at given times arrives, s; lost: infinity.

        Here the delay is constant; pictures of a user's own channel show that.

        Args:
            sent: Times in s, 0 to `duration` (N,).
            duration: How long the simulation lasts, s.
            stream: Name of the random numbers, as in MakeChannel.

        Raises:
            ScenarioError: If a field is not allowed.
        """
        return np.asarray(sent, dtype=float) + self.delay


class ChannelBlock(FixedBlock):
    """Base of the channels' blocks: a vector that comes out later.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    Attributes:
        initial_value: What is delivered at first (size).

    Args:
        delay: In s, finite and >= 0.
        size: Width of the signal, >= 1.
        initial_value: What is delivered at first (size); zeros if None.

    Raises:
        ScenarioError: If one of them is refused.
    """

    def __init__(self, delay: float, size: int, initial_value: Sequence[float] | None):
        CheckNumber("delay", delay, "s", minimum=0)
        CheckNumber("size", size, minimum=1)
        if initial_value is not None and len(initial_value) != size:
            Refuse("initial_value", initial_value, f"{size} numbers or null")
        self.initial_value = [0.0] * size if initial_value is None else initial_value

    def DeclarePassThrough(self) -> None:
        """Declares the ports; the output is the signal itself."""
        self._Declare(Kernel(outputs={"delayed_signal": "signal"}))

    def DeclareDelay(self, **line: Any) -> None:
        """Declares the ports; the output is delayed.

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
        outputs = {"delayed_signal": size}
        FixedBlock.__init__(self, "", kernel, inputs=inputs, outputs=outputs)
