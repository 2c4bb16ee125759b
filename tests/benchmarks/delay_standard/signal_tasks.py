"""Tasks of the delay standard in which a delay varies by a signal, or is sampled."""

import math
from collections.abc import Callable
from fractions import Fraction
from functools import cache

from benchmarks.delay_standard.task import (
    EXACT,
    MILLISECOND,
    STEP,
    Signal,
    Task,
    by_fault,
    delay_faults,
    every,
)
from benchmarks.delay_standard.wrong_methods import at_steps

SIGNAL_END = Fraction("0.8")


def swinging_delay(t: float) -> float:
    """Returns T(t) in s, whose slope reaches 1.6: what is shown goes back."""
    return 0.12 + 0.08 * math.cos(20 * t)


def signal_delay() -> Task:
    """A sine through a delay that swings."""

    def read(late: Callable[[float], float]) -> Signal:
        return lambda t: math.sin(3 * max(float(t) - late(float(t)), 0.0))

    def scaled(factor: float, more: float = 0.0) -> Signal:
        return read(lambda t: factor * swinging_delay(t) + more)

    step = float(STEP)
    faults = {
        "one_step_early": scaled(1.0, -step),
        "one_step_late": scaled(1.0, step),
        "half_delay": scaled(0.5),
        "double_delay": scaled(2.0),
        "no_delay": scaled(0.0),
        "delay_error": scaled(1.0, float(MILLISECOND)),
        "delay_of_last_step": read(lambda t: swinging_delay(t - step)),
        "delay_of_start": read(lambda t: swinging_delay(0.0)),
        "mean_delay": read(lambda t: 0.12),
        "rounded": read(lambda t: round(swinging_delay(t) / step) * step),
    }
    return Task(
        instants=every(STEP, SIGNAL_END),
        signals={"late": scaled(1.0)},
        tubes={"late": 2e-4},
        faults=by_fault({"late": faults}),
    )


ROOT_2 = math.sqrt(2.0)
STATE_END = 3.0


def state_delay() -> Task:
    """The problem of Feldstein and Neves, which begins at 0 here."""

    def exact(t: Fraction) -> float:
        time = 1.0 + float(t)
        if time < 2:
            return math.sqrt(time)
        return time / 4 + 0.5 + (1 - ROOT_2 / 2) * math.sqrt(time)

    first = ROOT_2 - 1

    def loop(late: Callable[[float], float], history: float = 1.0) -> Signal:
        x = _state_loop(late, history)
        return lambda t: x[round(float(t) * _STATE_STEPS)]

    faults = {
        "half_delay": loop(lambda T: T / 2),
        "double_delay": loop(lambda T: 2 * T),
        "no_delay": lambda t: math.exp(math.sqrt(1.0 + float(t)) - 1.0),
        "one_step_early": loop(lambda T: T - float(STEP)),
        "one_step_late": loop(lambda T: T + float(STEP)),
        "delay_error": loop(lambda T: T + float(MILLISECOND)),
        "delay_of_start": loop(lambda T: first),
        "empty_history": loop(lambda T: T, history=0.0),
        "explicit_euler": at_steps(_euler_states()),
    }
    return Task(
        instants=every(Fraction("0.05"), Fraction(3)),
        signals={"x": exact},
        tubes={"x": 2e-5},
        faults=by_fault({"x": faults}),
    )


_STATE_STEPS = 2000


@cache
def _euler_states() -> list[float]:
    """Returns x of the state-dependent loop at the steps of Euler's method, of 1 ms.

    The late value is interpolated between two steps.
    """
    step = float(MILLISECOND)
    x = [1.0]
    for k in range(round(STATE_END / step)):
        place = max((x[k] - ROOT_2) / step, 0.0)
        i = int(place)
        late = x[i] + (place - i) * (x[i + 1] - x[i]) if i > 0 else 1.0
        x.append(x[k] + step * late / (2 * math.sqrt(1 + k * step)))
    return x


def _state_loop(late: Callable[[float], float], history: float) -> list[float]:
    """Returns x of the state-dependent loop, by Heun's method with steps of 0.5 ms.

    Args:
        late: The delay, a function of the right one.
    """
    x = [1.0]

    def rate(k: int, now: float) -> float:
        t = k / _STATE_STEPS
        place = (t - late(t + ROOT_2 - now)) * _STATE_STEPS
        if place < 0:
            return history / (2 * math.sqrt(1 + t))
        i = min(int(place), len(x) - 1)
        following = x[i + 1] if i + 1 < len(x) else now
        delayed = x[i] + (place - i) * (following - x[i])
        return delayed / (2 * math.sqrt(1 + t))

    for k in range(round(STATE_END * _STATE_STEPS)):
        first = rate(k, x[k])
        second = rate(k + 1, x[k] + first / _STATE_STEPS)
        x.append(x[k] + (first + second) / (2 * _STATE_STEPS))
    return x


LENGTH = 0.3


def velocity(t: float) -> float:
    return 0.5 + math.sin(2 * t)


def distance(t: float) -> float:
    return t / 2 + math.sin(t) ** 2


def conveyor() -> Task:
    """What leaves tells when it has entered; the conveyor goes back from 1.83 s on."""

    def entered(length: float, path: Callable[[float], float] = distance) -> Signal:
        return lambda t: _entered(float(t), length, path)

    def present_speed(t: Fraction) -> float:
        speed = velocity(float(t))
        return max(float(t) - LENGTH / speed, 0.0) if speed > 0 else 0.0

    right = entered(LENGTH)
    step = float(STEP)
    faults = {
        "half_delay": entered(LENGTH / 2),
        "double_delay": entered(2 * LENGTH),
        "no_delay": float,
        "one_step_early": lambda t: right(t) + step if right(t) else 0.0,
        "one_step_late": lambda t: max(right(t) - step, 0.0),
        "delay_error": lambda t: max(right(t) - float(MILLISECOND), 0.0),
        "present_speed": present_speed,
        "no_reversal": entered(LENGTH, _travelled),
    }
    return Task(
        instants=every(Fraction("0.05"), Fraction(4)),
        signals={"entered": right},
        tubes={"entered": 2e-4},
        faults=by_fault({"entered": faults}),
    )


def _travelled(t: float) -> float:
    """Returns the distance with the magnitude of the velocity."""
    turns = [7 * math.pi / 12, 11 * math.pi / 12]
    total = 0.0
    begin = 0.0
    for end in [*(turn for turn in turns if turn < t), t]:
        total += abs(distance(end) - distance(begin))
        begin = end
    return total


def _entered(t: float, length: float, path: Callable[[float], float]) -> float:
    """Returns the last time before t when a path was shorter by a length, or 0."""
    level = path(t) - length
    high = t
    while path(high) > level:
        high -= 1e-3
        if high <= 0:
            return 0.0
    low = high
    high = low + 1e-3
    for _ in range(60):
        middle = (low + high) / 2
        if path(middle) > level:
            high = middle
        else:
            low = middle
    return low


GAIN = Fraction(4)
PERIOD = Fraction("0.1")
COMPUTING = Fraction("0.04")


def sampled() -> Task:
    """A hold in the loop: x' = -4 x(the last sample), 0.04 s after it was taken."""

    def loop(late: Fraction) -> Signal:
        return lambda t: _sampled_loop(t, late)

    faults = delay_faults(loop, COMPUTING)
    faults["one_period_late"] = loop(COMPUTING + PERIOD)
    return Task(
        instants=every(2 * STEP, Fraction(2)),
        signals={"x": loop(COMPUTING)},
        tubes={"x": EXACT},
        faults=by_fault({"x": faults}),
    )


def _sampled_loop(t: Fraction, late: Fraction) -> float:
    """Returns x(t) of x' = -GAIN x(k PERIOD) from k PERIOD + late on; 0 before."""
    x = Fraction(1)
    now = Fraction(0)
    rate = Fraction(0)
    samples: list[Fraction] = []
    while True:
        # First the sample, so that without a delay it acts at once.
        sample = len(samples) * PERIOD
        pending = [k * PERIOD + late for k in range(len(samples))]
        arrival = next((a for a in pending if a > now), math.inf)
        until = min(sample, arrival, t)
        x += rate * (until - now)
        now = until
        if sample == now:
            samples.append(x)
        arrived = [y for k, y in enumerate(samples) if k * PERIOD + late <= now]
        if arrived:
            rate = -GAIN * arrived[-1]
        if now == t:
            return float(x)
