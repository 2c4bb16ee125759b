"""Closed forms of the tasks of the delay standard.

Polynomials are summed in rational numbers (Fraction), so that nothing cancels.
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from typing import NamedTuple

from numpy.polynomial import Polynomial


def since(t: Fraction, start: Fraction, power: int) -> Fraction:
    """Returns (t - start)^power / power! behind the start, 0 before it."""
    if t <= start:
        return Fraction(0)
    return (t - start) ** power / math.factorial(power)


def scalar_loop(t: Fraction, k: Fraction, T: Fraction, history: int = 1) -> float:
    """Returns x(t) of x' = -k x(t - T), x(0) = 1, x(t < 0) = history (0 or 1).

    The Laplace transform is a geometric series in -k exp(-s T) / s.
    """
    x = Fraction(1)
    for j in range(1, math.ceil(t / T) + 2):
        x += (-k) ** j * since(t, (j - history) * T, j)
    return float(x)


@cache
def pd_loop(t: Fraction, Kp: Fraction, Kd: Fraction, T: Fraction) -> float:
    """Returns x(t) of x'' = Kp (1 - x(t - T)) - Kd x'(t - T), at rest at 0 before.

    X(s) = Kp / s^3 times the sum over j of (-(Kp + Kd s) exp(-s T) / s^2)^j.
    """
    x = Fraction(0)
    for j in range(math.ceil(t / T)):
        for i in range(j + 1):
            gain = math.comb(j, i) * Kp ** (j - i) * Kd**i
            x += (-1) ** j * gain * since(t, j * T, 2 * j + 2 - i)
    return float(Kp * x)


class Margin(NamedTuple):
    """The delay in s at which a loop oscillates, and its frequency in rad/s."""

    delay: float
    frequency: float


def pd_margin(Kp: float, Kd: float) -> Margin:
    """Returns where (Kp + Kd s) exp(-s T) = -s^2 first has a root s = j w."""
    w = math.sqrt((Kd**2 + math.sqrt(Kd**4 + 4 * Kp**2)) / 2)
    return Margin(delay=math.atan2(Kd * w, Kp) / w, frequency=w)


class Packet(NamedTuple):
    """A packet: its value, when it is sent and when it arrives, in s."""

    value: Fraction
    sent: Fraction
    arrival: Fraction


def newest(packets: Sequence[Packet], t: Fraction) -> Packet | None:
    """Returns the packet sent last among those that have arrived, if any."""
    arrived = [packet for packet in packets if packet.arrival <= t]
    return max(arrived, key=lambda packet: packet.sent, default=None)


def latest(packets: Sequence[Packet], t: Fraction) -> Packet | None:
    """Returns the packet that arrived last, whenever it was sent, if any."""
    arrived = [packet for packet in packets if packet.arrival <= t]
    return max(arrived, key=lambda packet: packet.arrival, default=None)


def in_order(packets: Sequence[Packet]) -> list[Packet]:
    """Returns the packets as they arrive where none overtakes an earlier one."""
    waiting: list[Packet] = []
    last = Fraction(0)
    for packet in packets:
        last = max(last, packet.arrival)
        waiting.append(packet._replace(arrival=last))
    return waiting


class Piece(NamedTuple):
    """A ball between two instants: polynomials of the time since `start`, s."""

    start: float
    height: Polynomial
    velocity: Polynomial


class Ball:
    """A ball that bounces, whose thrust depends on its velocity a round trip ago.

    x'' = -gravity - gain v(t - round_trip), v = 0 before 0; v becomes -bounce v where
    x reaches 0. Between impacts and their echoes x is a polynomial.

    Attributes:
        impacts: When it hits the ground, s.
    """

    GRAVITY = 9.81

    def __init__(self, *, gain: float, round_trip: float, bounce: float, end: float):
        self.impacts: list[float] = []
        self._gain = gain
        self._round_trip = round_trip
        at_rest = Polynomial([0.0])
        self._pieces = [Piece(-math.inf, Polynomial([1.0]), at_rest)]
        self._echoes = [round_trip]
        start = 0.0
        height = 1.0
        velocity = 0.0
        while start < end:
            piece = self._piece(start, height, velocity)
            self._pieces.append(piece)
            echo = min((t for t in self._echoes if t > start + 1e-12), default=end)
            impact = self._impact(piece, echo)
            after = min(echo if impact is None else impact, end)
            height = float(piece.height(after - start))
            velocity = float(piece.velocity(after - start))
            if impact is not None:
                self.impacts.append(impact)
                height = 0.0
                velocity = -bounce * velocity
            self._echoes.append(after + round_trip)
            start = after

    def _piece(self, start: float, height: float, velocity: float) -> Piece:
        """Returns what moves from an instant on until the next impact or echo."""
        late = start - self._round_trip
        source = self._covering(late + 1e-9)
        acceleration = Polynomial([-self.GRAVITY])
        if source.start >= 0:
            shift = Polynomial([late - source.start, 1.0])
            acceleration = acceleration - self._gain * source.velocity(shift)
        speed = acceleration.integ(k=velocity)
        return Piece(start, speed.integ(k=height), speed)

    @staticmethod
    def _impact(piece: Piece, before: float) -> float | None:
        """Returns when the ball reaches the ground within a piece, if it does."""
        roots = piece.height.roots()
        times = [root.real for root in roots if abs(root.imag) < 1e-9]
        gaps = [gap for gap in times if 1e-6 < gap < before - piece.start]
        falling = [gap for gap in gaps if piece.velocity(gap) < 0]
        return piece.start + min(falling) if falling else None

    def _covering(self, t: float) -> Piece:
        return next(piece for piece in reversed(self._pieces) if piece.start <= t)

    def height(self, t: float) -> float:
        piece = self._covering(t)
        return float(piece.height(t - piece.start)) if t > 0 else 1.0

    def velocity(self, t: float) -> float:
        piece = self._covering(t)
        return float(piece.velocity(t - piece.start)) if t > 0 else 0.0
