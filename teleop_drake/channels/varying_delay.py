"""Base of the channels whose delay varies with time."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.channels.base import ChannelConfig
from teleop_drake.channels.delay_profile import DelayProfile, Sinusoid
from teleop_drake.channels.trace import ENDS, UNITS, ReadTrace, Trace
from teleop_drake.validation import CheckChoice, CheckNumber, Refuse, Within

# Times between which the delay is taken to vary linearly where arrivals are asked for.
_NUM_TIMES = 2000


@dataclass(kw_only=True, eq=False)
class VaryingDelayConfig(ChannelConfig):
    """A channel whose delay varies; `delay` is the mean, on which the rest adds."""

    file_fields: ClassVar[tuple[str, ...]] = ("trace",)

    # Growth of the delay, s/s.
    drift: float = 0.0
    sinusoid: Sinusoid = field(default_factory=Sinusoid)
    # A file with measured delays, which are added: CSV with the columns time and
    # delay, or what ping printed; see channels.trace. It is interpolated linearly;
    # null: none. In a scenario file the path is relative to that file.
    trace: str | None = None
    # Unit of its delays, one of UNITS: s, ms, us; null: what the file says, else s.
    trace_unit: str | None = None
    # Names of its columns of time and delay; null: two columns, or those with such
    # names.
    trace_columns: list[str] | None = None
    # What the delays are multiplied by, > 0; null: 0.5 for the round trips of ping and
    # of a column rtt, of which half goes either way, else 1.
    trace_factor: float | None = None
    # One of ENDS, where the simulation outlasts it: refuse, hold, repeat.
    trace_end: str = "refuse"

    def EntryPeriod(self) -> float | None:
        """Returns the time in s between entries of the trace that have none.

        None: the file says when they were taken.
        """
        return None

    def MeasuredDelays(self, duration: float, path: str) -> Trace | None:
        """Reads the trace, if there is one."""
        if self.trace_unit is not None:
            CheckChoice(f"{path}.trace_unit", self.trace_unit, UNITS)
        CheckChoice(f"{path}.trace_end", self.trace_end, ENDS)
        if self.trace_factor is not None:
            CheckNumber(f"{path}.trace_factor", self.trace_factor, above=0)
        if self.trace is None:
            return None
        read = ReadTrace(
            f"{path}.trace",
            self.trace,
            unit=self.trace_unit,
            columns=self.trace_columns,
            sample_period=self.EntryPeriod(),
        )
        with Within(path):
            trace = read.Until(duration, self.trace_end)
        if trace.times[-1] < duration:
            Refuse(
                f"{path}.trace",
                self.trace,
                f"at least as long as the duration, {duration:g} s, not "
                f"{trace.times[-1]:g} s; trace_end says what to do else, hold or "
                "repeat",
            )
        factor = self.trace_factor or (0.5 if trace.is_round_trip else 1.0)
        return replace(trace, delays=trace.delays * factor)

    def Profile(self, duration: float, path: str = "channel") -> DelayProfile:
        """Returns how the delay varies with time, jitter apart; reads the trace."""
        return self.ProfileOf(self.MeasuredDelays(duration, path), duration, path)

    def ProfileOf(
        self, trace: Trace | None, duration: float, path: str
    ) -> DelayProfile:
        """Returns the same with a trace that has been read.

        Args:
            trace: What MeasuredDelays() returned.
            duration: Until when, in s.
            path: The channel's field in a scenario, for messages.
        """
        with Within(path):
            return DelayProfile(
                delay=self.delay,
                drift=self.drift,
                sinusoid=self.sinusoid,
                trace=None if trace is None else (trace.times, trace.delays),
                duration=duration,
            )

    def LargestSlope(self, duration: float) -> float:
        """Returns an upper bound of dT/dt, jitter apart."""
        return self.Profile(duration).max_slope

    def Arrivals(
        self, sent: ArrayLike, duration: float, stream: str = ""
    ) -> NDArray[np.float64]:
        """Returns when what is sent at given times arrives in s, jitter apart.

        What arrives at t was sent at t - T(t). What arrives after the end is taken to
        be delayed as at the end.
        """
        profile = self.Profile(duration)
        sent = np.asarray(sent, dtype=float)
        times = np.linspace(0.0, duration, _NUM_TIMES)
        left = np.array([t - profile(t) for t in times])
        return np.where(
            sent <= left[-1], np.interp(sent, left, times), sent + profile(duration)
        )
