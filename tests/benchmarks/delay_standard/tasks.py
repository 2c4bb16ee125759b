"""The tasks of the delay standard: right answers, tubes, and likely wrong answers.

`python tests/benchmarks/delay_standard/write_references.py` makes files of them. The
texts are in teleop_drake/references/delays.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache

from benchmarks.delay_standard import closed_forms
from benchmarks.delay_standard.by_steps import by_steps
from benchmarks.delay_standard.closed_forms import Ball, Packet, pd_loop, scalar_loop

# Of t in s, an exact number.
Signal = Callable[[Fraction], float]

STEP = Fraction(1, 100)
"""Step of a simulator whose step is fixed, s. Jumps fall between two steps."""

MILLISECOND = Fraction(1, 1000)
"""By how much a delay is too long in the fault `delay_error`, s."""

EXACT = 1e-9
"""Tube of signals that a fixed step represents exactly."""


@dataclass
class Task:
    """A task: its answers at some instants.

    Attributes:
        instants: In s.
        signals: The right answers, by name.
        tubes: Half the width of each signal's tube.
        faults: By the name of a fault, the signals as they are with it. Signals that
            the fault leaves right are not there.
    """

    instants: list[Fraction]
    signals: dict[str, Signal]
    tubes: dict[str, float]
    faults: dict[str, dict[str, Signal]] = field(default_factory=dict)


def every(period: Fraction, end: Fraction, but: Sequence[Fraction] = ()) -> list:
    """Returns the multiples of a period until an end, without some of them."""
    count = math.floor(end / period)
    return [k * period for k in range(1, count + 1) if k * period not in but]


def ramp(t: Fraction) -> float:
    return float(t)


def step_at(instant: Fraction) -> Signal:
    return lambda t: float(t >= instant)


def echo(signal: Signal, T: Fraction, initial: float = 0.0) -> Signal:
    """Returns a signal a delay T later; before, the initial value."""
    return lambda t: signal(t - T) if t >= T else initial


def delay_faults(make: Callable[[Fraction], Signal], T: Fraction) -> dict[str, Signal]:
    """Returns a signal as it is with a wrong delay, by the fault."""
    return {
        "one_step_early": make(T - STEP),
        "one_step_late": make(T + STEP),
        "half_delay": make(T / 2),
        "double_delay": make(2 * T),
        "no_delay": make(Fraction(0)),
        "delay_error": make(T + MILLISECOND),
    }


def by_fault(faults: dict[str, dict[str, Signal]]) -> dict[str, dict[str, Signal]]:
    """Turns faults by signal into signals by fault."""
    result: dict[str, dict[str, Signal]] = {}
    for name, answers in faults.items():
        for fault, answer in answers.items():
            result.setdefault(fault, {})[name] = answer
    return result


def plain_echo() -> Task:
    inputs = {"ramp_echo": ramp, "step_echo": step_at(Fraction("0.105"))}
    T = Fraction("0.1")
    faults = {}
    for name, signal in inputs.items():
        faults[name] = delay_faults(lambda late, u=signal: echo(u, late), T)
    # A shift of a jump is no multiple of a shorter one.
    del faults["step_echo"]["delay_error"]
    return Task(
        instants=every(STEP, Fraction("0.4")),
        signals={name: echo(signal, T) for name, signal in inputs.items()},
        tubes=dict.fromkeys(inputs, EXACT),
        faults=by_fault(faults),
    )


def vector_echo() -> Task:
    inputs: dict[str, Signal] = {
        "position_echo": lambda t: math.sin(5 * t),
        "velocity_echo": lambda t: 1 - math.cos(5 * t),
        "force_echo": ramp,
    }
    T = Fraction("0.1")
    faults = {}
    for name, signal in inputs.items():
        faults[name] = delay_faults(lambda late, u=signal: echo(u, late), T)
        faults[name]["not_connected"] = lambda t: 0.0
    return Task(
        instants=every(STEP, Fraction("0.4")),
        signals={name: echo(signal, T) for name, signal in inputs.items()},
        tubes=dict.fromkeys(inputs, EXACT),
        faults=by_fault(faults),
    )


def half_step() -> Task:
    """2.5 steps. The smeared step is read half a step behind a sample."""
    T = Fraction("0.025")
    jump = step_at(Fraction("0.103"))
    read_at = Fraction("0.13")
    right = echo(jump, T)
    faults: dict[str, dict[str, Signal]] = {
        "ramp_echo": {
            "rounded_down": echo(ramp, T - STEP / 2),
            "rounded_up": echo(ramp, T + STEP / 2),
            "one_step_early": echo(ramp, T - STEP),
            "one_step_late": echo(ramp, T + STEP),
            "no_delay": ramp,
            "delay_error": echo(ramp, T + MILLISECOND),
        },
        "step_echo": {
            "rounded_up": lambda t: 0.0 if t == read_at else right(t),
            "smeared_step": lambda t: 0.5 if t == read_at else right(t),
            "no_delay": jump,
        },
    }
    return Task(
        instants=every(STEP, Fraction("0.4")),
        signals={"ramp_echo": echo(ramp, T), "step_echo": right},
        tubes={"ramp_echo": EXACT, "step_echo": EXACT},
        faults=by_fault(faults),
    )


def short_delay() -> Task:
    T = Fraction("0.004")

    def loop(late: Fraction) -> Signal:
        if late == 0:
            return lambda t: math.exp(-20 * t)
        return lambda t: scalar_loop(t, Fraction(20), late)

    faults: dict[str, dict[str, Signal]] = {
        "ramp_echo": {
            "rounded_up": echo(ramp, STEP),
            "one_step_late": echo(ramp, T + STEP),
            "no_delay": ramp,
            "delay_error": echo(ramp, T + MILLISECOND),
        },
        "x": {
            "rounded_up": loop(STEP),
            "one_step_late": loop(T + STEP),
            "no_delay": loop(Fraction(0)),
            "delay_error": loop(T + MILLISECOND),
        },
    }
    return Task(
        instants=every(STEP, Fraction("0.3")),
        signals={"ramp_echo": echo(ramp, T), "x": loop(T)},
        tubes={"ramp_echo": EXACT, "x": 1e-3},
        faults=by_fault(faults),
    )


def delayed_decay() -> Task:
    k, T = Fraction(1), Fraction(1)

    def loop(late: Fraction) -> Signal:
        if late == 0:
            return lambda t: math.exp(-t)
        return lambda t: scalar_loop(t, k, late)

    faults = delay_faults(loop, T)
    faults["empty_history"] = lambda t: scalar_loop(t, k, T, history=0)
    return Task(
        instants=every(Fraction("0.2"), Fraction(10)),
        signals={"x": loop(T)},
        tubes={"x": 1e-4},
        faults=by_fault({"x": faults}),
    )


KP, KD = Fraction(4), Fraction(2)
SENSOR, ACTUATOR = Fraction("0.06"), Fraction("0.04")


def pd() -> Task:
    """The setpoint is not delayed by the sensor, so an actuator delays all of x."""
    T = SENSOR + ACTUATOR

    def shifted(late: Fraction, start: Fraction) -> Signal:
        """Returns x with a round trip, which begins to move at an instant."""
        if late == 0:
            no_delay = by_steps(_pd_rate, [1.0], [0.0, 0.0], 4.0)
            return lambda t: float(no_delay(float(t - start))[0])
        return lambda t: pd_loop(t - start, KP, KD, late)

    def lagging_position(t: Fraction) -> float:
        return float(_position_only()(float(t))[0])

    zero = Fraction(0)
    sensor = {f"{key}": x for key, x in _pd_faults(T, zero, shifted).items()}
    sensor["velocity_not_delayed"] = lagging_position
    both = _pd_faults(T, ACTUATOR, shifted)
    both["actuator_only"] = shifted(ACTUATOR, ACTUATOR)
    both["sensor_only"] = shifted(SENSOR, zero)
    return Task(
        instants=every(Fraction("0.05"), Fraction(4)),
        signals={
            "x_sensor": shifted(T, zero),
            "x_actuator": shifted(T, T),
            "x_both": shifted(T, ACTUATOR),
        },
        tubes=dict.fromkeys(["x_sensor", "x_actuator", "x_both"], 1e-4),
        faults=by_fault(
            {
                "x_sensor": sensor,
                "x_actuator": _pd_faults(T, T, shifted),
                "x_both": both,
            }
        ),
    )


def _pd_faults(T: Fraction, start: Fraction, shifted: Callable) -> dict[str, Signal]:
    """Returns x with a wrong round trip; an actuator's delay is wrong with it."""
    share = start / T
    return delay_faults(lambda late: shifted(late, share * late), T)


def _pd_rate(t, now, late):
    return [now[1], float(KP) * (1 - now[0]) - float(KD) * now[1]]


@cache
def _position_only():
    """Returns the PD loop whose position is delayed, but not its velocity."""

    def rate(t, now, late):
        return [now[1], float(KP) * (1 - late[0][0]) - float(KD) * now[1]]

    return by_steps(rate, [float(SENSOR + ACTUATOR)], [0.0, 0.0], 4.0)


def oscillation() -> Task:
    right = closed_forms.pd_margin(float(KP), float(KD))
    step = float(STEP)
    return Task(
        instants=[Fraction(0)],
        signals={
            "critical_delay": lambda t: right.delay,
            "frequency": lambda t: right.frequency,
        },
        tubes={"critical_delay": 5e-7, "frequency": 5e-6},
        faults={
            "delay_error": {"critical_delay": lambda t: right.delay - 1e-3},
            "one_step_early": {"critical_delay": lambda t: right.delay + step},
            "one_step_late": {"critical_delay": lambda t: right.delay - step},
            "half_delay": {"critical_delay": lambda t: 2 * right.delay},
            "radians": {"frequency": lambda t: right.frequency / (2 * math.pi)},
        },
    )


def sawtooth_delay(t: Fraction) -> Fraction:
    """Returns T(t) in s: it grows from 0.05 to 0.15 and falls at once."""
    return Fraction("0.05") + (t + Fraction("0.005")) % Fraction("0.2") / 2


def sawtooth() -> Task:
    def read(t: Fraction) -> float:
        return float(max(t - sawtooth_delay(t), 0))

    def late_reading(t: Fraction) -> float:
        return float(max(t - sawtooth_delay(t) - MILLISECOND, 0))

    def before(t: Fraction) -> float:
        """The delay is what it was a step ago."""
        return float(max(t - sawtooth_delay(t - STEP), 0))

    def at_sending(t: Fraction) -> float:
        """What is sent at s arrives at s + T(s); the newest is shown."""
        sent = [k * STEP / 20 for k in range(int(t / STEP) * 20 + 1)]
        return float(max((s for s in sent if s + sawtooth_delay(s) <= t), default=0))

    faults = {
        "delay_at_sending": at_sending,
        "delay_of_last_step": before,
        "delay_of_start": echo(ramp, sawtooth_delay(Fraction(0))),
        "mean_delay": echo(ramp, Fraction("0.1")),
        "one_step_early": lambda t: read(t) + float(STEP) if read(t) else 0.0,
        "no_delay": ramp,
        "delay_error": late_reading,
    }
    return Task(
        instants=every(STEP, Fraction("0.8")),
        signals={"ramp_echo": read},
        tubes={"ramp_echo": EXACT},
        faults=by_fault({"ramp_echo": faults}),
    )


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


def packets() -> Task:
    sent = jittered_packets()
    constant = [packet._replace(arrival=packet.sent + 11 * STEP / 2) for packet in sent]
    newest = closed_forms.newest
    right = shown(newest, sent)
    faults = {
        "last_to_arrive": shown(closed_forms.latest, sent),
        "kept_in_order": shown(newest, closed_forms.in_order(sent)),
        "mean_delay": shown(newest, constant),
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


def watched(age: Callable[[Packet], Fraction], limit: Fraction) -> Signal:
    """Returns the command, which is 0 once the packet's age is the limit."""

    @cache
    def value(t: Fraction) -> float:
        packet = closed_forms.newest(stale_packets(), t)
        is_stale = packet is None or t >= age(packet) + limit
        return 0.0 if is_stale else float(packet.value)

    return value


def travel(command: Signal) -> Signal:
    """Returns the integral of a command that jumps at odd multiples of 0.005 s."""
    half = STEP / 2

    def value(t: Fraction) -> float:
        intervals = range(int(t / half))
        return math.fsum(command((k + Fraction(1, 2)) * half) for k in intervals) * (
            float(half)
        )

    return value


def stale_command() -> Task:
    right = watched(lambda packet: packet.arrival, TIMEOUT)
    never = Fraction(10)
    commands = {
        "held_for_ever": watched(lambda packet: packet.arrival, never),
        "zeroed_at_once": watched(lambda packet: packet.arrival, SEND_PERIOD),
        "timeout_from_sending": watched(lambda packet: packet.sent, TIMEOUT),
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


WAY = 0.15
GAIN, BOUNCE = 0.5, 0.8
BOUNCE_END = 1.5


def ball(way: float = WAY, gain: float = GAIN) -> Ball:
    return Ball(gain=gain, round_trip=2 * way, bounce=BOUNCE, end=BOUNCE_END)


def bounce() -> Task:
    right = ball()
    jumps = [hit + k * WAY for hit in right.impacts for k in range(2)]
    instants = [
        t
        for t in every(2 * STEP, Fraction(3, 2))
        if all(abs(float(t) - jump) > 2e-3 for jump in jumps)
    ]

    def answers(model: Ball, way: float) -> dict[str, Signal]:
        return {
            "height": lambda t: model.height(float(t)),
            "velocity": lambda t: model.velocity(float(t)),
            "felt": lambda t: model.velocity(float(t) - way),
        }

    signals = answers(right, WAY)
    tubes = {"height": 1e-3, "velocity": 5e-3, "felt": 5e-3}
    faults = {
        "no_delay_felt": {"felt": signals["velocity"]},
        "no_echo": answers(ball(gain=0.0), WAY),
        "half_delay": answers(ball(WAY / 2), WAY / 2),
        "double_delay": answers(ball(2 * WAY), 2 * WAY),
    }
    # Height and velocity are then those of half a delay each way.
    faults["one_way_only"] = {"felt": answers(ball(WAY / 2), WAY)["felt"]}
    return Task(instants, signals, tubes, faults)


def tie() -> Task:
    first, second = Fraction("0.14"), Fraction("0.15")
    T = first + second
    jump = step_at(Fraction("0.105"))
    arrival = T + Fraction("0.105")
    right = echo(jump, T)
    return Task(
        instants=every(STEP, Fraction("0.6")),
        signals={"direct": right, "chain": right, "area": lambda t: 0.0},
        tubes=dict.fromkeys(["direct", "chain", "area"], EXACT),
        faults={
            "one_step_early": {
                name: echo(jump, T - STEP) for name in ("direct", "chain")
            },
            "one_step_late": {
                name: echo(jump, T + STEP) for name in ("direct", "chain")
            },
            "one_step_apart": {"area": lambda t: float(STEP * (t > arrival))},
        },
    )


SWITCHED = {
    "first": Fraction("0.1"),
    "second": Fraction("0.03"),
    "third": Fraction("0.1"),
}
RUN_END = Fraction("0.4")


def switch() -> Task:
    """Runs one after another, with another delay each."""

    def signal(t: Fraction) -> float:
        return 1.0 + float(t)

    faults: dict[str, dict[str, Signal]] = {"left_over": {}, "not_switched": {}}
    before = SWITCHED["first"]
    for name, T in list(SWITCHED.items())[1:]:
        faults["left_over"][name] = echo(signal, T, initial=signal(RUN_END - before))
        faults["not_switched"][name] = echo(signal, before)
        before = T
    for name, T in SWITCHED.items():
        for fault, answer in delay_faults(lambda late: echo(signal, late), T).items():
            faults.setdefault(fault, {})[name] = answer
    del faults["delay_error"]
    return Task(
        instants=every(STEP, RUN_END, but=list(SWITCHED.values())),
        signals={name: echo(signal, T) for name, T in SWITCHED.items()},
        tubes=dict.fromkeys(SWITCHED, EXACT),
        faults=faults,
    )


TASKS: dict[str, Callable[[], Task]] = {
    "delay_echo": plain_echo,
    "delay_vector": vector_echo,
    "delay_half_step": half_step,
    "delay_short": short_delay,
    "delay_decay": delayed_decay,
    "delay_pd": pd,
    "delay_oscillation": oscillation,
    "delay_sawtooth": sawtooth,
    "delay_packets": packets,
    "delay_stale_command": stale_command,
    "delay_bounce": bounce,
    "delay_tie": tie,
    "delay_switch": switch,
}
