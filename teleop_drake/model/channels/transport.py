"""A channel with an exact, constant delay."""

import math
from collections.abc import Sequence

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.framework.validation import Config
from teleop_drake.model.channels.base import ChannelConfig
from teleop_drake.model.kinds import NumberNames


@Config
class TransportChannelConfig(ChannelConfig):
    """Delays the signal exactly by `delay`; 0 passes it through."""

    kind = "transport"

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> TransportDelay:
        """Makes the block; see ChannelConfig.MakeChannel."""
        return TransportDelay(
            delay=self.delay,
            size=size,
            initial_value=initial_value,
            # LongestStep() limits the steps of the solver instead.
            max_sample_interval=math.inf,
        )

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        unused: NumberNames = {"seed": (), "duration": ()}
        # Without delay the block is another one, and delays of fields are further ones.
        is_number = self.delay > 0 and not self.fields
        return {**unused, "delay": ("delay",)} if is_number else unused

    def LongestStep(self, duration: float) -> float:
        """Returns the delay in s; a signal that arrives in a step was sent earlier."""
        return self.delay or math.inf

    def IsPassThrough(self) -> bool:
        """Returns whether there is no delay."""
        return self.delay == 0
