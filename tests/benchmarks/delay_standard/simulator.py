"""What a simulator offers to the delay standard, and its answers to the tasks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from benchmarks.delay_standard.tasks import ACTUATOR, SENSOR, SWITCHED, sawtooth_delay

Array = np.ndarray

NEVER = 1e6


class NotOffered(Exception):
    """The simulator is not made for this task; the text says why."""


@dataclass(frozen=True)
class Input:
    """A vector signal of time.

    Attributes:
        size: Its width.
        function: Of an array: t in s, and 0 before `jump`, 1 from then on.
        jump: In s.
    """

    size: int
    function: Callable
    jump: float = NEVER

    def __call__(self, t: float) -> Array:
        is_behind = float(t >= self.jump - 1e-9)
        return self.function(np.array([t, is_behind]))


RAMP = Input(1, lambda z: z[:1])
STEP = Input(1, lambda z: z[1:], 0.105)
RAMP_AND_STEP = Input(2, lambda z: z, 0.105)
RAMP_AND_EARLY_STEP = Input(2, lambda z: z, 0.103)
FIELDS = Input(3, lambda z: np.array([np.sin(5 * z[0]), 1 - np.cos(5 * z[0]), z[0]]))
SHIFTED_RAMP = Input(1, lambda z: 1 + z[:1])


class Simulator:
    """Base of the adapters. What one does not override is not offered.

    Times are in s, ascending, and multiples of 0.01 s.
    """

    name = ""
    # Delays of loops are multiples of it, s; 0: any.
    pd_step = 0.0

    def echo(self, signal: Input, path: Sequence[float], times: Array) -> Array:
        """Returns a signal behind some delays, one after another (N, size)."""
        raise NotOffered("no outputs besides its state")

    def varying_echo(self, signal: Input, T: Callable, times: Array) -> Array:
        """Returns signal(t - T(t)), 0 while t < T(t) (N, size)."""
        raise NotOffered("no delay that jumps")

    def switched_echo(self, signal: Input, delays: Sequence[float], times) -> Array:
        """Returns the signal behind each delay, in runs of one model (N, runs)."""
        raise NotOffered("delays are fixed")

    def scalar_loop(self, k: float, T: float, times: Array) -> Array:
        """Returns x of x' = -k x(t - T), x = 1 at 0 and before (N)."""
        raise NotOffered("no equations of the first order")

    def pd(self, sensor: float, actuator: float, times: Array) -> Array:
        """Returns x of the PD loop with two delays (N)."""
        raise NotOffered("no loops")

    def signal_delay(self, times: Array) -> Array:
        """Returns what delay_signal shows (N)."""
        raise NotOffered("no adapter for it")

    def state_delay(self, times: Array) -> Array:
        """Returns x of delay_state (N)."""
        raise NotOffered("no adapter for it")

    def conveyor(self, times: Array) -> Array:
        """Returns what leaves the conveyor in delay_conveyor (N)."""
        raise NotOffered("no adapter for it")

    def sampled(self, times: Array) -> Array:
        """Returns x of delay_sampled (N)."""
        raise NotOffered("no adapter for it")

    def packets(self, times: Array) -> Array:
        """Returns what the receiver shows in delay_packets (N)."""
        raise NotOffered("no packets")

    def stale_command(self, times: Array) -> Array:
        """Returns command and travel of delay_stale_command (N, 2)."""
        raise NotOffered("no packets")

    def bounce(self, times: Array) -> Array:
        """Returns height, velocity and what is felt in delay_bounce (N, 3)."""
        raise NotOffered("no adapter for it")


def _tie(simulator: Simulator, times: Array) -> Array:
    direct = simulator.echo(STEP, [0.29], times)[:, 0]
    chain = simulator.echo(STEP, [0.14, 0.15], times)[:, 0]
    area = np.cumsum(np.abs(direct - chain)) * (times[1] - times[0])
    return np.column_stack([direct, chain, area])


def _short(simulator: Simulator, times: Array) -> Array:
    late = simulator.echo(RAMP, [0.004], times)[:, 0]
    return np.column_stack([late, simulator.scalar_loop(20.0, 0.004, times)])


def _pd(simulator: Simulator, times: Array) -> Array:
    sensor = float(SENSOR)
    actuator = float(ACTUATOR)
    total = sensor + actuator
    loops = [(total, 0.0), (0.0, total), (sensor, actuator)]
    return np.column_stack([simulator.pd(*delays, times) for delays in loops])


def dominant_mode(x: Array, period: float) -> complex:
    """Returns the exponent in 1/s of the slowest oscillation of samples about 0.

    Samples of one oscillation satisfy x(t + p) = a x(t) + b x(t - p).
    """
    past = np.column_stack([x[1:-1], x[:-2]])
    a, b = np.linalg.lstsq(past, x[2:], rcond=None)[0]
    return complex(np.log(np.roots([1, -a, -b]).astype(complex)[0]) / period)


def _oscillation(simulator: Simulator, times: Array) -> Array:
    """Looks for the delay whose loop neither grows nor decays, by secants.

    The first 20 s are left out: by then, other modes have decayed.
    """
    grid = np.arange(1, 3201) * 0.01

    def mode(T: float) -> complex:
        x = simulator.pd(T, 0.0, grid)[2000:] - 1
        return dominant_mode(x[::25], 0.25)

    step = simulator.pd_step
    late = 0.36
    early = 0.35
    growth = mode(late).real
    before = mode(early).real
    for _ in range(8):
        next_delay = late - growth * (late - early) / (growth - before)
        next_delay = round(next_delay / step) * step if step else next_delay
        if abs(next_delay - late) < 1e-9:
            break
        early = late
        before = growth
        late = next_delay
        growth = mode(late).real
    critical = late - growth * (late - early) / (growth - before)
    return np.array([[critical, abs(mode(late).imag)]])


def _echo_of(signal: Input, path: list[float]) -> Callable:
    return lambda simulator, times: simulator.echo(signal, path, times)


ANSWERS: dict[str, Callable[[Simulator, Array], Array]] = {
    "delay_echo": _echo_of(RAMP_AND_STEP, [0.1]),
    "delay_vector": _echo_of(FIELDS, [0.1]),
    "delay_half_step": _echo_of(RAMP_AND_EARLY_STEP, [0.025]),
    "delay_short": _short,
    "delay_decay": lambda simulator, times: simulator.scalar_loop(1.0, 1.0, times),
    "delay_pd": _pd,
    "delay_oscillation": _oscillation,
    "delay_sawtooth": lambda simulator, times: simulator.varying_echo(
        RAMP, sawtooth_delay, times
    ),
    "delay_packets": lambda simulator, times: simulator.packets(times),
    "delay_stale_command": lambda simulator, times: simulator.stale_command(times),
    "delay_bounce": lambda simulator, times: simulator.bounce(times),
    "delay_tie": _tie,
    "delay_switch": lambda simulator, times: simulator.switched_echo(
        SHIFTED_RAMP, [float(T) for T in SWITCHED.values()], times
    ),
    "delay_signal": lambda simulator, times: simulator.signal_delay(times),
    "delay_state": lambda simulator, times: simulator.state_delay(times),
    "delay_conveyor": lambda simulator, times: simulator.conveyor(times),
    "delay_sampled": lambda simulator, times: simulator.sampled(times),
}
"""By task, the signals of a simulator at times, a column each."""
