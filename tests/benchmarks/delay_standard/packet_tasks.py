"""The tasks of the delay standard in which packets are sent."""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache

from benchmarks.delay_standard import closed_forms
from benchmarks.delay_standard.closed_forms import Packet
from benchmarks.delay_standard.task import EXACT, STEP, Signal, Task, by_fault, every

SEND_PERIOD = Fraction("0.02")


def jittered_packets() -> list[Packet]:
    """Returns packets that overtake: k is sent at 0.02 k with the value k + 1."""
    packets = []
    for k in range(26):
        sent = k * SEND_PERIOD
        flight = Fraction("0.015") + Fraction("0.02") * (7 * k % 5)
        packets.append(Packet(Fraction(k + 1), sent, sent + flight))
    return packets


def shown(choose: Callable, packets: Sequence[Packet]) -> Signal:
    """Returns the value of the packet that a rule chooses, 0 before the first."""

    def value(t: Fraction) -> float:
        packet = choose(packets, t)
        return 0.0 if packet is None else float(packet.value)

    return value


def half_flights(packets: Sequence[Packet]) -> list[Packet]:
    """Returns packets that travel for half of their time."""
    return [x._replace(arrival=(x.sent + x.arrival) / 2) for x in packets]


def packets() -> Task:
    sent = jittered_packets()
    constant = [packet._replace(arrival=packet.sent + 11 * STEP / 2) for packet in sent]
    newest = closed_forms.newest
    right = shown(newest, sent)
    faults = {
        "last_to_arrive": shown(closed_forms.latest, sent),
        "kept_in_order": shown(newest, closed_forms.in_order(sent)),
        "mean_delay": shown(newest, constant),
        "half_delay": shown(newest, half_flights(sent)),
        "one_step_early": lambda t: right(t + STEP),
        "one_step_late": lambda t: right(t - STEP),
    }
    return Task(
        instants=every(STEP, Fraction("0.5")),
        signals={"shown": right},
        tubes={"shown": EXACT},
        faults=by_fault({"shown": faults}),
    )


TIMEOUT = Fraction("0.1")


def stale_packets() -> list[Packet]:
    """Returns what arrives: packet k has 1, 2 or 3; those from 0.2 to 0.5 s do not."""
    lost = range(10, 25)
    late = Fraction("0.055")
    numbers = [k for k in range(40) if k not in lost]
    return [
        Packet(Fraction(1 + k % 3), k * SEND_PERIOD, k * SEND_PERIOD + late)
        for k in numbers
    ]


def watched(
    age: Callable[[Packet], Fraction],
    limit: Fraction,
    packets: Sequence[Packet] = stale_packets(),
) -> Signal:
    """Returns the command, which is 0 once the packet's age is the limit."""

    @cache
    def value(t: Fraction) -> float:
        packet = closed_forms.newest(packets, t)
        is_stale = packet is None or t >= age(packet) + limit
        return 0.0 if is_stale else float(packet.value)

    return value


def travel(command: Signal) -> Signal:
    """Returns the integral of a command that jumps at multiples of 0.0025 s."""
    part = STEP / 4

    def value(t: Fraction) -> float:
        intervals = range(int(t / part))
        return math.fsum(command((k + Fraction(1, 2)) * part) for k in intervals) * (
            float(part)
        )

    return value


def stale_command() -> Task:
    right = watched(lambda packet: packet.arrival, TIMEOUT)
    never = Fraction(10)
    commands = {
        "held_for_ever": watched(lambda packet: packet.arrival, never),
        "zeroed_at_once": watched(lambda packet: packet.arrival, SEND_PERIOD),
        "timeout_from_sending": watched(lambda packet: packet.sent, TIMEOUT),
        "half_delay": watched(
            lambda packet: packet.arrival, TIMEOUT, half_flights(stale_packets())
        ),
        "one_step_early": lambda t: right(t + STEP),
        "one_step_late": lambda t: right(t - STEP),
    }
    return Task(
        instants=every(STEP, Fraction("0.8")),
        signals={"command": right, "travel": travel(right)},
        tubes={"command": EXACT, "travel": 1e-4},
        faults={
            name: {"command": command, "travel": travel(command)}
            for name, command in commands.items()
        },
    )
