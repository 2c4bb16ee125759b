"""The base class of channels: how a scenario configures a delay."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.loops.delays.base import CheckDelay
from teleop_drake.loops.delays.netem import Netem
from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import Config, Refuse
from teleop_drake.model.kinds import KindConfig

# The packets for which netem gets room, as a multiple of those under way on average.
_ROOM = 4


@dataclass(frozen=True, kw_only=True)
class ConstantDelay:
    """The constant delay by which a linear analysis replaces a channel.

    Attributes:
        delay: The delay in s.
        note: A sentence on how it approximates the channel; None: it is exact.
    """

    delay: float
    note: str | None = None


@Config
class ChannelConfig(KindConfig, ABC):
    """One direction of the communication (thesis section 2.1, Fig. 2.1).

    A channel of your own derives from this class, adds its fields, and makes its block
    in MakeChannel. A scenario selects it by the name of its class:
    `kind: my_module:MyChannel`.

    Attributes:
        draws_random_numbers: Whether runs with different seeds differ.
        has_packet_statistics: Whether its block has a method Statistics(context), which
            returns PacketStatistics.
    """

    draws_random_numbers: ClassVar[bool] = False
    has_packet_statistics: ClassVar[bool] = False

    # Delay, s, >= 0. Kinds with a varying delay add the variation to it. Default:
    # thesis section 4.2.
    delay: float = 0.1
    # Seed of the random numbers, a whole number >= 0. The two directions draw different
    # numbers even if their seeds are equal. No effect on kinds that draw none.
    seed: int = 0
    # Delays of single fields of a packet, {name: {delay: s}}, before it is sent: the
    # camera's image is older than the force in the same packet. The names are those of
    # the architecture: force, velocity, position and others; see Architecture.
    fields: dict[str, Any] = field(default_factory=dict)

    def Check(self, path: str, duration: float) -> None:
        """Checks every field.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: Duration of the simulation, s.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        CheckDelay(f"{path}.delay", self.delay)
        if self.seed < 0:
            Refuse(f"{path}.seed", self.seed, "a whole number >= 0")
        for name, given in self.fields.items():
            place = f"{path}.fields.{name}"
            if not isinstance(given, dict) or set(given) != {"delay"}:
                Refuse(place, given, "a mapping with the key delay")
            if not isinstance(given["delay"], int | float):
                Refuse(f"{place}.delay", given["delay"], "a number (s)")
            CheckDelay(f"{place}.delay", given["delay"])

    def FieldDelays(self) -> list[float]:
        """Returns the delays of single fields in s that are not 0."""
        return [x["delay"] for x in self.fields.values() if x["delay"] > 0]

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
            initial_value: The output before the first packet or sample arrives (size).
            duration: Duration of the simulation, s.
            stream: Name of the channel; each name has random numbers of its own.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """

    def LongestStep(self, duration: float) -> float:
        """Returns the longest step in s that the solver may take, or infinity.

        Args:
            duration: Duration of the simulation, s.
        """
        return math.inf

    def PacketPeriod(self) -> float:
        """Returns the period of the packets in s; infinity: there are no packets.

        A step of the solver ends at each packet.
        """
        return math.inf

    def IsPassThrough(self) -> bool:
        """Returns whether the output is the input itself, without delay."""
        return False

    def NominalDelay(self, duration: float) -> float:
        """Returns the delay in s from which defaults of an architecture derive.

        Args:
            duration: Duration of the simulation, s.
        """
        return self.delay

    def LargestSlope(self, duration: float) -> float:
        """Returns an upper bound of dT/dt of the delay T.

        Args:
            duration: Duration of the simulation, s.
        """
        return 0.0

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the constant delay with which a linear analysis replaces the channel.

        By default, this is the field `delay`, which is right for a channel that delays
        by a constant time.

        Args:
            path: The channel's field in a scenario, for messages.
            duration: Duration of the simulation, s.

        Raises:
            ScenarioError: If no constant delay can stand for the channel.
        """
        return ConstantDelay(delay=self.delay)

    def AsNetem(self, duration: float) -> tuple[Netem, list[str]]:
        """Returns options of netem with which a link behaves like the channel.

        Args:
            duration: Duration of the simulation, s.

        Returns:
            The options, and what netem cannot do of the channel, in words.
        """
        period = self.PacketPeriod()
        missing = [
            f"the older field {name}, which the sender has to delay by {x['delay']:g} s"
            for name, x in self.fields.items()
            if x["delay"] > 0
        ]
        if period == math.inf:
            return Netem(delay=round(1e9 * self.delay)), missing
        limit = max(1000, math.ceil(_ROOM * self.delay / period))
        missing.append(f"a packet every {period:g} s, which the sender has to send")
        return Netem(delay=round(1e9 * self.delay), limit=limit), missing

    def Arrivals(self, sent: ArrayLike, duration: float, stream: str = "") -> Array:
        """Returns the arrival times of signals sent at given times, s; lost: infinity.

        By default, the delay is constant. A page shows a channel of your own in this
        way unless it overrides this method.

        Args:
            sent: Times when the signals are sent, s, 0 to `duration` (N,).
            duration: Duration of the simulation, s.
            stream: Name of the channel, as in MakeChannel.

        Raises:
            ScenarioError: If a field is not allowed.
        """
        return np.asarray(sent, dtype=float) + self.delay
