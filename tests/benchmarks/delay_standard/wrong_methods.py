"""Loops with the right delays and a method that errs: Euler's, or Pade's delay."""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from typing import NamedTuple

import numpy as np
from benchmarks.delay_standard.closed_forms import Margin
from benchmarks.delay_standard.task import MILLISECOND, Signal
from scipy.linalg import block_diag, expm
from scipy.optimize import brentq

ORDERS = (1, 2, 3, 4, 5, 8)
"""The orders of Pade's approximation whose wrong answers are written."""


def _count(T: Fraction) -> int:
    """Returns a delay in steps of Euler's method, which have a millisecond."""
    return int(T / MILLISECOND)


@cache
def euler_scalar(k: Fraction, T: Fraction, end: Fraction) -> list[float]:
    """Returns x at the steps of Euler's method for x' = -k x(t - T), 1 before 0."""
    late = _count(T)
    change = float(k * MILLISECOND)
    x = [1.0]
    for n in range(_count(end)):
        x.append(x[n] - change * (x[n - late] if n >= late else 1.0))
    return x


@cache
def euler_pd(
    sensor: Fraction, actuator: Fraction, end: Fraction, *, is_semi_implicit: bool
) -> list[float]:
    """Returns x of the PD loop of delay_pd at the steps of Euler's method.

    The semi-implicit one moves the mass by its new velocity.
    """
    h = float(MILLISECOND)
    x = [0.0]
    v = [0.0]
    commands = []
    for n in range(_count(end)):
        seen = n - _count(sensor)
        felt = 4 * x[seen] + 2 * v[seen] if seen >= 0 else 0.0
        commands.append(4.0 - felt)
        acting = n - _count(actuator)
        force = commands[acting] if acting >= 0 else 0.0
        v.append(v[n] + h * force)
        x.append(x[n] + h * (v[n + 1] if is_semi_implicit else v[n]))
    return x


def at_steps(values: Sequence[float]) -> Signal:
    """Returns values at multiples of a millisecond as a signal."""
    return lambda t: values[_count(t)]


def euler_margin(Kp: float, Kd: float, *, is_semi_implicit: bool) -> Margin:
    """Returns the critical delay of delay_oscillation by Euler's method.

    With z = e^(j w h) its loop has r^2 + (Kp q + Kd r) e^(-j w T) = 0, r = (z - 1)/h,
    where q is z for the semi-implicit method and 1 for the explicit one.
    """
    h = float(MILLISECOND)

    def loop(w: float) -> complex:
        z = complex(np.exp(1j * w * h))
        rate = (z - 1) / h
        return -(Kp * (z if is_semi_implicit else 1.0) + Kd * rate) / rate**2

    w = brentq(lambda w: abs(loop(w)) - 1, 0.1, 100.0, xtol=1e-14)
    return Margin(delay=float(np.angle(loop(w)) % (2 * math.pi)) / w, frequency=w)


class System(NamedTuple):
    """dx/dt = A x + B u, y = C x + D u, with one input and one output."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: float


def pade(T: Fraction, order: int) -> System:
    """Returns Pade's approximation of a delay, with as many zeros as poles."""
    # In units of time in which the poles have a magnitude of about 1.
    unit = float(T) / (1.3 * order)
    powers = range(order, -1, -1)
    ascending = [
        math.comb(order, k) * math.factorial(2 * order - k) * (1.3 * order) ** k
        for k in powers
    ]
    below = np.array(ascending) / ascending[0]
    above = below * [(-1.0) ** k for k in powers]
    D = above[0]
    A = np.eye(order, k=-1)
    A[0] = -below[1:]
    return System(A / unit, np.eye(order)[0] / unit, above[1:] - D * below[1:], D)


def in_series(first: System, second: System) -> System:
    A = block_diag(first.A, second.A)
    n = len(first.A)
    A[n:, :n] = np.outer(second.B, first.C)
    return System(
        A,
        np.append(first.B, second.B * first.D),
        np.append(second.D * first.C, second.C),
        first.D * second.D,
    )


def pade_echo(system: System, source: System, start: Fraction = Fraction(0)) -> Signal:
    """Returns what a system makes of a signal, its state being 0 before the start.

    Args:
        system: The approximation of the delays.
        source: The signal is C e^(A (t - start)) B, 0 before.
    """
    A = block_diag(system.A, source.A)
    n = len(system.A)
    A[:n, n:] = np.outer(system.B, source.C)
    C = np.append(system.C, system.D * source.C)
    signal = _solution(A, np.append(np.zeros(n), source.B), C)
    return lambda t: signal(t - start) if t >= start else 0.0


def _solution(A: np.ndarray, begin: np.ndarray, C: np.ndarray) -> Signal:
    """Returns C e^(A t) begin at multiples of a millisecond."""
    step = expm(A * float(MILLISECOND))
    states = [begin]

    def value(t: Fraction) -> float:
        while len(states) <= _count(t):
            states.append(step @ states[-1])
        return float(C @ states[_count(t)])

    return value


def source(A: Sequence, B: Sequence, C: Sequence) -> System:
    return System(np.array(A, float), np.array(B, float), np.array(C, float), 0.0)


STEP_SOURCE = source([[0]], [1], [1])
RAMP_SOURCE = source([[0, 1], [0, 0]], [0, 1], [1, 0])
SINE_SOURCE = source([[0, 5], [-5, 0]], [0, 1], [1, 0])
COSINE_SOURCE = source([[0, 5, 0], [-5, 0, 0], [0, 0, 0]], [1, 0, 1], [-1, 0, 1])
"""Sources of 1, t, sin(5 t), 1 - cos(5 t)."""


def pade_scalar(k: Fraction, T: Fraction, order: int) -> Signal:
    """Returns x of x' = -k x(t - T), whose deviation from 1 is what is late."""
    late = pade(T, order)
    n = order
    A = np.zeros((n + 2, n + 2))
    A[:n, :n] = late.A
    A[:n, n] = late.B
    A[n, :n] = -float(k) * late.C
    A[n, n] = -float(k) * late.D
    A[n, n + 1] = -float(k)
    change = _solution(A, np.eye(n + 2)[n + 1], np.eye(n + 2)[n])
    return lambda t: 1.0 + change(t)


def pade_pd(sensor: Fraction, actuator: Fraction, order: int) -> Signal:
    """Returns x of the PD loop of delay_pd."""
    nothing = System(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0)
    seen = pade(sensor, order) if sensor else nothing
    acts = pade(actuator, order) if actuator else nothing
    n = len(seen.A)
    m = len(acts.A)
    # The states: of the delays, x and v, and the constant 1.
    x = n + m
    command = np.zeros(x + 3)
    command[:n] = -seen.C
    command[x : x + 2] = -seen.D * np.array([4.0, 2.0])
    command[x + 2] = 4.0
    A = np.zeros((x + 3, x + 3))
    A[:n, :n] = seen.A
    A[:n, x : x + 2] = np.outer(seen.B, [4.0, 2.0])
    A[n:x] = np.outer(acts.B, command)
    A[n:x, n:x] += acts.A
    A[x, x + 1] = 1.0
    A[x + 1] = acts.D * command
    A[x + 1, n:x] += acts.C
    return _solution(A, np.eye(x + 3)[x + 2], np.eye(x + 3)[x])


def by_orders(make: Callable[[int], Signal]) -> dict[str, Signal]:
    """Returns the wrong answers by Pade's approximation, keyed by fault."""
    return {f"pade:{order}": make(order) for order in ORDERS}
