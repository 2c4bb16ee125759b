"""What the kinds of channels have in common whose delay varies with time."""

from dataclasses import dataclass, field
from typing import ClassVar

from teleop_drake.channels.base import ChannelConfig
from teleop_drake.channels.delay_profile import DelayProfile, Sinusoid
from teleop_drake.channels.trace import ReadTrace
from teleop_drake.validation import Refuse, Within


@dataclass(kw_only=True, eq=False)
class VaryingDelayConfig(ChannelConfig):
    """A channel whose delay varies; `delay` is the mean, on which the rest adds."""

    file_fields: ClassVar[tuple[str, ...]] = ("trace",)

    # Growth of the delay, s/s.
    drift: float = 0.0
    sinusoid: Sinusoid = field(default_factory=Sinusoid)
    # A CSV file with the columns time and delay, both in s, which is added. It covers
    # the duration and is interpolated linearly; null: none. In a scenario file the path
    # is relative to that file.
    trace: str | None = None

    def Profile(self, duration: float, path: str = "channel") -> DelayProfile:
        """Returns how the delay varies with time, jitter apart; reads the trace.

        Args:
            duration: Until when, in s.
            path: The channel's field in a scenario, for messages.

        Raises:
            ScenarioError: If a field is not allowed.
        """
        trace = None
        if self.trace is not None:
            times, _ = trace = ReadTrace(f"{path}.trace", self.trace)
            if times[-1] - times[0] < duration:
                Refuse(
                    f"{path}.trace",
                    self.trace,
                    f"at least as long as the duration, {duration:g} s, not "
                    f"{times[-1] - times[0]:g} s",
                )
        with Within(path):
            return DelayProfile(
                delay=self.delay,
                drift=self.drift,
                sinusoid=self.sinusoid,
                trace=trace,
                duration=duration,
            )

    def LargestSlope(self, duration: float) -> float:
        """Returns an upper bound of dT/dt, jitter apart.

        Args:
            duration: How long the simulation lasts, s.
        """
        return self.Profile(duration).max_slope
