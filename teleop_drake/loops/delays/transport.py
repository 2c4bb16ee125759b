"""An exact, constant delay."""

from collections.abc import Sequence

from teleop_drake.loops.delays.base import ChannelBlock
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.kernel import Delay
from teleop_drake.loops.kernel.linear_part import LinearPart


class TransportDelay(ChannelBlock):
    """Delays a vector signal by an exact, constant time.

        delayed_signal(t) = signal(t - delay)    for t > t0 + delay
                          = initial_value        before

    where t0 is the time at which the simulation starts. The delay need not be a
    multiple of a step or a period. This is the block T of Fig. 2.1.

    | port | name           | size | unit      |
    |------|----------------|------|-----------|
    | in   | signal         | size | any       |
    | out  | delayed_signal | size | of signal |

    | parameter | name      | unit |
    |-----------|-----------|------|
    | 0         | delay     | s    |

    State and treatment of jumps: those of DelayLine.

    Initial value: `initial_value` is delivered until the first sample arrives.

    Direct feedthrough: none, unless delay is 0. Then the block is a pass-through
    with neither state nor events.

    Steps: a periodic event without effect ends a step at least once per
    `max_sample_interval`, also in a diagram without continuous states. It adds steps
    needlessly if the integrator's own steps are short enough; infinity removes it.

    It does not extrapolate, so no step can be longer than the delay. It does not
    report derivatives and cannot vary its delay.

    Attributes:
        delay: The delay in s.

    Args:
        delay: Delay in s, >= 0.
        size: Width of the signal, >= 1.
        initial_value: The output before the first sample arrives (size); zeros if None.
        max_sample_interval: Longest time between two samples in s, in (0, delay];
            infinity: one sample for each step of the integrator. None: 0.01 s, or the
            delay if that is less.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        delay: float,
        size: int,
        initial_value: Sequence[float] | None = None,
        *,
        max_sample_interval: float | None = None,
    ):
        ChannelBlock.__init__(self, delay=delay, size=size, initial_value=initial_value)
        self.delay = float(delay)
        if delay == 0:
            self.DeclarePassThrough()
            return
        self.DeclareDelay(time=self.delay, max_sample_interval=max_sample_interval)

    def ZeroDelay(self) -> Delay:
        """Returns the delay of a block that passes its signal on."""
        return Delay(
            signal="signal",
            output="delayed_signal",
            initial_value=self.initial_value,
            time=0.0,
        )

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns the delay as a linear part."""
        return LinearPart(delay=self.delay)
