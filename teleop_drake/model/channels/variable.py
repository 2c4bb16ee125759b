"""Channels whose exact delay varies with time but not at random."""

import math
from collections.abc import Callable, Sequence
from dataclasses import field, replace

import numpy as np

from teleop_drake.loops.delays.netem import Netem
from teleop_drake.loops.delays.variable import DelayProfile, Sinusoid, VariableDelay
from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import (
    CheckChoice,
    Config,
    Refuse,
    Within,
)
from teleop_drake.model.channels.base import ChannelConfig, ConstantDelay
from teleop_drake.model.channels.trace import ENDS, ReadTrace, Trace
from teleop_drake.model.kinds import FileOf, GivenFile
from teleop_drake.model.tables.histogram import Histogram

# Number of instants at which Arrivals() evaluates the delay; it interpolates linearly.
_NUM_TIMES = 2000

# Number of instants at which a varying delay is evaluated to compute its mean.
_NUM_MEAN_TIMES = 20001


@Config
class VaryingDelayConfig(ChannelConfig):
    """Base of the channels with a varying delay: `delay` plus the parts below."""

    file_fields = ("trace",)

    # Growth of the delay, s/s.
    drift: float = 0.0
    sinusoid: Sinusoid = field(default_factory=Sinusoid)
    # A file of measured delays, which are added: a table, the output of ping, or the
    # JSON of a tool. A mapping {file, columns: {role: column}, units: {role: unit},
    # interval} names what the file does not tell; see tables.ReadPackets(). The delays
    # are interpolated linearly. Null: no trace. In a scenario file the path is relative
    # to that file.
    trace: GivenFile | None = None
    # The treatment of a trace that is shorter than the simulation, one of ENDS: refuse,
    # hold, repeat.
    trace_end: str = "refuse"

    def Read(
        self, duration: float, path: str = "channel", stream: str = ""
    ) -> tuple[DelayProfile, Trace | None]:
        """Returns the delay without jitter as a function of time, and the trace.

        Args:
            duration: The time until which the delay is needed, in s.
            path: The channel's field in a scenario, for messages.
            stream: Name of the channel, as in MakeChannel.
        """
        CheckChoice(f"{path}.trace_end", self.trace_end, ENDS)
        trace = None
        if self.trace is not None:
            draw = self.DrawTrace(duration, stream)
            trace = ReadTrace(f"{path}.trace", self.trace, draw)
        with Within(path):
            if trace is not None:
                trace = trace.Until(duration, self.trace_end)
                if trace.times[-1] < duration and self.trace_end != "hold":
                    Refuse(
                        "trace",
                        self.trace,
                        f"at least as long as the duration, {duration:g} s, not "
                        f"{trace.times[-1]:g} s, unless trace_end is hold or repeat",
                    )
            profile = DelayProfile(
                delay=self.delay,
                drift=self.drift,
                sinusoid=self.sinusoid,
                trace=None if trace is None else (trace.times, trace.delays),
                duration=duration,
            )
        return profile, trace

    def DrawTrace(
        self, duration: float, stream: str
    ) -> Callable[[Histogram], Trace] | None:
        """Returns a function that draws a trace from a histogram of delays.

        None: the channel has no packets, so that a histogram is refused.
        """
        return None

    def Profile(self, duration: float, path: str = "channel") -> DelayProfile:
        """Returns the delay without jitter as a function of time; reads the trace."""
        profile, _ = self.Read(duration, path)
        return profile

    def AsNetem(self, duration: float) -> tuple[Netem, list[str]]:
        """Returns options of netem with the mean delay; see ChannelConfig."""
        netem, missing = super().AsNetem(duration)
        varies = {
            "drift": self.drift != 0,
            "sinusoid": self.sinusoid.amplitude != 0,
            "trace": self.trace is not None,
        }
        names = [name for name, is_given in varies.items() if is_given]
        if not names:
            return netem, missing
        mean = round(1e9 * self.MeanDelay(duration))
        missing.append(
            f"a delay that varies with time ({', '.join(names)}): the line has the "
            f"mean, {1e-6 * mean:.4g} ms"
        )
        return replace(netem, delay=mean), missing

    def NominalDelay(self, duration: float) -> float:
        """Returns `delay`, and with a trace the mean delay of what it says, s."""
        return self.delay if self.trace is None else self.MeanDelay(duration)

    def MeanDelay(self, duration: float) -> float:
        """Returns the mean of T over the duration in s, without jitter."""
        times = np.linspace(0.0, duration, _NUM_MEAN_TIMES)
        delays = self.Profile(duration)(times)
        return float(np.trapezoid(delays, times) / duration)

    def LargestSlope(self, duration: float) -> float:
        """Returns an upper bound of dT/dt without jitter."""
        return self.Profile(duration).max_slope

    def Arrivals(self, sent: ArrayLike, duration: float, stream: str = "") -> Array:
        """Returns the arrival times of signals sent at given times, s, without jitter.

        A signal that arrives at t was sent at t - T(t). Arrivals after the end of the
        simulation are computed with the delay at the end.
        """
        profile = self.Profile(duration)
        sent = np.asarray(sent, dtype=float)
        times = np.linspace(0.0, duration, _NUM_TIMES)
        left = times - profile(times)
        return np.where(
            sent <= left[-1],
            np.interp(sent, left, times),
            sent + float(profile(duration)),
        )


@Config
class VariableChannelConfig(VaryingDelayConfig):
    """Delays the signal exactly by a continuous T(t), which preserves its order."""

    kind = "variable"

    def Check(self, path: str, duration: float) -> None:
        """Checks every field; reads the trace."""
        super().Check(path, duration)
        profile, trace = self.Read(duration, path)
        if trace is not None and trace.is_lost.any():
            Refuse(
                f"{path}.trace",
                self.trace,
                f"without losses, and has {int(trace.is_lost.sum())}; where packets "
                "are lost, kind must be network",
            )
        with Within(path):
            profile.CheckContinuous(FileOf(self.trace) or "")

    def MakeChannel(
        self,
        *,
        size: int,
        initial_value: Sequence[float],
        duration: float = math.inf,
        stream: str = "",
    ) -> VariableDelay:
        """Makes the block; see ChannelConfig.MakeChannel."""
        profile, trace = self.Read(duration)
        block = VariableDelay(
            profile=profile,
            size=size,
            initial_value=initial_value,
            # LongestStep() limits the steps of the solver instead.
            max_sample_interval=math.inf,
        )
        block.notes = [] if trace is None else [trace.summary]
        return block

    def LongestStep(self, duration: float) -> float:
        """Returns a lower bound of the delay in s."""
        return self.Profile(duration).minimum

    def AsConstantDelay(self, path: str, duration: float) -> ConstantDelay:
        """Returns the mean of T over the duration.

        The result is valid while T changes slowly compared with the loop. A T that
        changes fast may destabilise a loop that is stable for each constant value of T,
        and it may stabilise a loop that is not.
        """
        profile = self.Profile(duration, path)
        times = np.linspace(0.0, duration, _NUM_MEAN_TIMES)
        delays = profile(times)
        delay = self.MeanDelay(duration)
        return ConstantDelay(
            delay=delay,
            note=f"{path}: the delay varies from {delays.min():.4g} to "
            f"{delays.max():.4g} s; the margins hold for a constant delay, here the "
            f"mean, {delay:.4g} s.",
        )
