"""The tasks of the delay standard: right answers, tubes, and likely wrong answers.

`python tests/benchmarks/delay_standard/write_references.py` makes files of them. The
texts are in teleop_drake/references/delays.
"""

import functools
import math
from collections.abc import Callable
from fractions import Fraction
from functools import cache

from benchmarks.delay_standard import closed_forms, wrong_methods
from benchmarks.delay_standard.by_steps import by_steps
from benchmarks.delay_standard.closed_forms import Ball, pd_loop, scalar_loop
from benchmarks.delay_standard.packet_tasks import packets, stale_command
from benchmarks.delay_standard.signal_tasks import (
    conveyor,
    sampled,
    signal_delay,
    state_delay,
)
from benchmarks.delay_standard.task import (
    EXACT,
    MILLISECOND,
    STEP,
    Signal,
    Task,
    by_fault,
    delay_faults,
    echo,
    every,
    ramp,
    step_at,
)

SOURCES = {
    "ramp_echo": (wrong_methods.RAMP_SOURCE, Fraction(0)),
    "step_echo": (wrong_methods.STEP_SOURCE, Fraction("0.105")),
    "position_echo": (wrong_methods.SINE_SOURCE, Fraction(0)),
    "velocity_echo": (wrong_methods.COSINE_SOURCE, Fraction(0)),
    "force_echo": (wrong_methods.RAMP_SOURCE, Fraction(0)),
}


def _pade_echoes(
    path: list[Fraction], source: wrong_methods.System, start: Fraction
) -> dict[str, Signal]:
    """Returns the echoes of a signal behind Pade's approximations of some delays."""

    def make(order: int) -> Signal:
        parts = [wrong_methods.pade(T, order) for T in path]
        system = functools.reduce(wrong_methods.in_series, parts)
        return wrong_methods.pade_echo(system, source, start)

    return wrong_methods.by_orders(make)


def plain_echo() -> Task:
    inputs = {"ramp_echo": ramp, "step_echo": step_at(Fraction("0.105"))}
    T = Fraction("0.1")
    faults = {}
    for name, signal in inputs.items():
        faults[name] = delay_faults(lambda late, u=signal: echo(u, late), T)
        faults[name] |= _pade_echoes([T], *SOURCES[name])
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
        faults[name] |= _pade_echoes([T], *SOURCES[name])
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
            "half_delay": echo(ramp, T / 2),
            "no_delay": ramp,
            "delay_error": echo(ramp, T + MILLISECOND),
            **_pade_echoes([T], *SOURCES["ramp_echo"]),
        },
        "step_echo": {
            **_pade_echoes([T], wrong_methods.STEP_SOURCE, Fraction("0.103")),
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
    end = Fraction("0.3")

    def loop(late: Fraction) -> Signal:
        if late == 0:
            return lambda t: math.exp(-20 * t)
        return lambda t: scalar_loop(t, Fraction(20), late)

    faults: dict[str, dict[str, Signal]] = {
        "ramp_echo": {
            "rounded_up": echo(ramp, STEP),
            "one_step_late": echo(ramp, T + STEP),
            "half_delay": echo(ramp, T / 2),
            "no_delay": ramp,
            "delay_error": echo(ramp, T + MILLISECOND),
        },
        "x": {
            "half_delay": loop(T / 2),
            "rounded_up": loop(STEP),
            "one_step_late": loop(T + STEP),
            "no_delay": loop(Fraction(0)),
            "delay_error": loop(T + MILLISECOND),
            "explicit_euler": wrong_methods.at_steps(
                wrong_methods.euler_scalar(Fraction(20), T, end)
            ),
        },
    }
    return Task(
        instants=every(STEP, end),
        signals={"ramp_echo": echo(ramp, T), "x": loop(T)},
        tubes={"ramp_echo": EXACT, "x": 1e-3},
        faults=by_fault(faults),
    )


def delayed_decay() -> Task:
    k = Fraction(1)
    T = Fraction(1)

    def loop(late: Fraction) -> Signal:
        if late == 0:
            return lambda t: math.exp(-t)
        return lambda t: scalar_loop(t, k, late)

    faults = delay_faults(loop, T)
    faults["empty_history"] = lambda t: scalar_loop(t, k, T, history=0)
    end = Fraction(10)
    euler = wrong_methods.euler_scalar(k, T, end)
    faults["explicit_euler"] = wrong_methods.at_steps(euler)
    faults |= wrong_methods.by_orders(lambda n: wrong_methods.pade_scalar(k, T, n))
    return Task(
        instants=every(Fraction("0.2"), end),
        signals={"x": loop(T)},
        tubes={"x": 1e-4},
        faults=by_fault({"x": faults}),
    )


KP = Fraction(4)
KD = Fraction(2)
SENSOR = Fraction("0.06")
ACTUATOR = Fraction("0.04")


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
    sensor = _pd_faults(T, zero, shifted) | _method_faults(T, zero)
    sensor["velocity_not_delayed"] = lagging_position
    actuator = _pd_faults(T, T, shifted) | _method_faults(zero, T)
    both = _pd_faults(T, ACTUATOR, shifted) | _method_faults(SENSOR, ACTUATOR)
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
                "x_actuator": actuator,
                "x_both": both,
            }
        ),
    )


def _pd_faults(T: Fraction, start: Fraction, shifted: Callable) -> dict[str, Signal]:
    """Returns x with a wrong round trip; an actuator's delay is wrong with it."""
    share = start / T
    return delay_faults(lambda late: shifted(late, share * late), T)


def _method_faults(sensor: Fraction, actuator: Fraction) -> dict[str, Signal]:
    """Returns x with the right delays, by a method that errs."""
    end = Fraction(4)
    faults = {
        name: wrong_methods.at_steps(
            wrong_methods.euler_pd(sensor, actuator, end, is_semi_implicit=is_semi)
        )
        for name, is_semi in EULER.items()
    }
    pade = functools.partial(wrong_methods.pade_pd, sensor, actuator)
    return faults | wrong_methods.by_orders(pade)


EULER = {"explicit_euler": False, "semi_implicit_euler": True}
"""Whether the method of a fault is semi-implicit."""


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
    euler = {
        name: wrong_methods.euler_margin(float(KP), float(KD), is_semi_implicit=is_semi)
        for name, is_semi in EULER.items()
    }
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
            **{
                name: {"critical_delay": lambda t, found=found: found.delay}
                for name, found in euler.items()
            },
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

    def rounded(t: Fraction) -> float:
        """The delay is the nearest whole number of steps."""
        return float(max(t - round(sawtooth_delay(t) / STEP) * STEP, 0))

    def at_sending(t: Fraction) -> float:
        """What is sent at s arrives at s + T(s); the newest is shown."""
        sent = [k * STEP / 20 for k in range(int(t / STEP) * 20 + 1)]
        return float(max((s for s in sent if s + sawtooth_delay(s) <= t), default=0))

    faults = {
        "delay_at_sending": at_sending,
        "delay_of_last_step": before,
        "rounded": rounded,
        "delay_of_start": echo(ramp, sawtooth_delay(Fraction(0))),
        "mean_delay": echo(ramp, Fraction("0.1")),
        "half_delay": lambda t: float(max(t - sawtooth_delay(t) / 2, 0)),
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


WAY = 0.15
GAIN = 0.5
BOUNCE = 0.8
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
    first = Fraction("0.14")
    second = Fraction("0.15")
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
            "half_delay": {name: echo(jump, T / 2) for name in ("direct", "chain")},
            **by_fault(
                {
                    "direct": _pade_echoes([T], *SOURCES["step_echo"]),
                    "chain": _pade_echoes([first, second], *SOURCES["step_echo"]),
                }
            ),
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
    "delay_signal": signal_delay,
    "delay_state": state_delay,
    "delay_conveyor": conveyor,
    "delay_sampled": sampled,
}
