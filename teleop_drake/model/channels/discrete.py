"""A channel that is Drake's DiscreteTimeDelay, which samples and holds the signal."""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import Adder, ConstantVectorSource, DiscreteTimeDelay

from teleop_drake.loops.framework.validation import Config, Refuse
from teleop_drake.loops.framework.wiring import Wire
from teleop_drake.loops.numerics.instants import TIE
from teleop_drake.model.channels.base import ChannelConfig, ConstantDelay
from teleop_drake.model.channels.sampled import CheckSamplePeriod


@Config
class DiscreteChannelConfig(ChannelConfig):
    """Drake's DiscreteTimeDelay(h, n), with h = sample_period and n h = delay.

    It samples the signal every h, also at t = 0. A sample is delivered n h later and
    held for h. The mean delay is (n + 1/2) h. With n = 0 it only samples and holds.
    """

    kind = "discrete"

    # h, s, > 0. The delay is a multiple of it. Assumed.
    sample_period: float = 0.01

    def Check(self, path: str, duration: float) -> None:
        """Checks every field."""
        super().Check(path, duration)
        CheckSamplePeriod(path, self.sample_period, self.delay)
        num_periods = self.delay / self.sample_period
        if abs(num_periods - round(num_periods)) > TIE:
            Refuse(
                f"{path}.delay",
                self.delay,
                f"a whole number of sample periods, {self.sample_period:g} s each",
            )

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> System:
        """Makes the block; see ChannelConfig.MakeChannel.

        Drake's block delivers zeros at first. If the initial value is not zero, the
        block delays the difference of the signal from it.
        """
        self.Check("channel", duration)
        num_periods = round(self.delay / self.sample_period)
        delay = DiscreteTimeDelay(self.sample_period, num_periods, size)
        if not np.any(initial_value):
            return delay
        return _DelayOfDifference(delay, np.array(initial_value, dtype=float))

    def PacketPeriod(self) -> float:
        """Returns the sample period in s."""
        return self.sample_period

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the mean delay (n + 1/2) h; see SampledChannelConfig."""
        delay = self.delay + self.sample_period / 2
        return ConstantDelay(
            delay=delay,
            note=f"{path}: DiscreteTimeDelay holds each sample for "
            f"{self.sample_period:g} s; its mean delay (n + 1/2) h is {delay:g} s, and "
            "the margins hold for a constant delay of that size.",
        )


def _DelayOfDifference(delay: DiscreteTimeDelay, initial_value: np.ndarray) -> Diagram:
    """Returns a diagram of initial_value + delayed (signal - initial_value)."""
    size = initial_value.size
    return Wire(
        Diagram(),
        "discrete_channel",
        {
            "minus_initial": ConstantVectorSource(-initial_value),
            "plus_initial": ConstantVectorSource(initial_value),
            "difference": Adder(2, size),
            "total": Adder(2, size),
            "delay": delay,
        },
        inputs={"signal": ["difference.u0"]},
        connections={
            "difference.u1": "minus_initial",
            "delay": "difference",
            "total.u0": "delay",
            "total.u1": "plus_initial",
        },
        outputs={"delayed_signal": "total"},
    )
