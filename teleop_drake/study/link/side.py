"""One side of the loop over a real network, with one packet each way per period."""

import contextlib
import functools
import gc
import signal
import socket
import sys
import time
from collections.abc import Callable
from hashlib import blake2b
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import CheckNumber
from teleop_drake.loops.numerics.step_polynomials import straight_steps
from teleop_drake.loops.run.compiled_run import OutcomeOf
from teleop_drake.loops.run.run import Ending
from teleop_drake.model.run.scenario_run import MakeRecording
from teleop_drake.model.scenario import (
    AsTeleoperation,
    CheckSteps,
    Scenario,
    ScenarioLike,
)
from teleop_drake.model.scenario.tree import ToTree
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.study.link.half import Driver, Half, Turn
from teleop_drake.study.link.measurements import TIMES, Measurements, Tick
from teleop_drake.study.link.packets import (
    WRONG_KEY_NOTICE,
    Address,
    FirstPacket,
    Reason,
    Session,
)

# Packets that the operator's side receives before the start, to measure round trips.
_NUM_EXCHANGES = 10
# Packets that report the end of a side, in case some are lost.
_NUM_FAREWELLS = 3
# The most datagrams that are read in a period, so that a flood takes little time.
_MAX_DATAGRAMS = 256
_DATAGRAM_SIZE = 2048
# The least time between two notices of a wrong key, ns.
_NOTICE_PERIOD = 1_000_000_000

_OVER = "the other side has ended"

Say = functools.partial(print, "teleop-drake:", file=sys.stderr, flush=True)
"""Prints a line for the user."""


class Side(Half):
    """One side of the loop in real time, whose tick k is k periods after tick 0.

    The robot's side has its tick 0 at the time of the operator's tick 0, converted to
    its own clock. The conversion assumes that both directions of the shortest round
    trip took half of it. An error of the conversion makes one measured delay longer and
    the other one shorter, and changes nothing that the operator feels.

    Args:
        scenario: The scenario of the whole loop. Except for the operator, it must be
            the same on both sides, and so must `period`, `limit` and `fade`.
        side: `operator`, which calls, or `robot`, which answers.
        key: The key of both sides (32 bytes).
        end: A non-blocking socket.
        address: The address of the robot's side, which the operator's side needs.
        clock: A function that returns the time of a monotonic clock, ns.
        period: The time between packets, s.
        limit: The largest round trip of the packet in use, s: the time since this side
            sent the packet that the other side had in use when it answered. Beyond the
            limit, trust falls within `fade` s of periods that were not missed; see
            Half.
        fade: The time in which trust falls from 1 to 0, and comes back, s.
        patience: The duration of silence after which the side ends, s.
        say: A function that shows a line to the user.
        step: A driver that replaces the simulation, called once a period. The device
            that it drives has to become safe by itself when it is no longer called.
        log_file: The file to which each tick is appended; None: none.

    Attributes:
        next_time: The time at which Tick() is due, by the clock, ns.
        tick: The last tick; -1 before the start.
        reason: Why the side has ended; empty if it is complete, None while it runs.
        measured: The ticks, and the packets in use at them.
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        side: str,
        key: bytes,
        end: socket.socket,
        address: Address | None = None,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        period: float = 0.001,
        limit: float = 0.5,
        fade: float = 0.1,
        patience: float = 5.0,
        say: Callable[[str], None] = Say,
        step: Driver | None = None,
        log_file: Path | None = None,
    ):
        scenario = AsTeleoperation(scenario)
        CheckSteps(scenario)
        times = {"period": period, "limit": limit, "fade": fade, "patience": patience}
        for name, seconds in times.items():
            CheckNumber(name, seconds, "s", minimum=1e-4)
        Half.__init__(self, scenario, side, period, fade, step=step)
        self.limit = limit
        self._patience = patience
        self._clock = clock
        self.Say = say
        # The network.
        self._socket = end
        agreement = _Agreement(scenario, period, limit, fade)
        role = 1 if side == "robot" else 0
        self._session = Session(key, role, agreement, self.fed.size, address)
        # The newest packet that was received: the packet in use.
        self._newest = FirstPacket(self.fed)
        self._peer_has_ended = False
        # The reasons that were reported why the two sides cannot connect.
        self._told: dict[Reason, str] = {}
        self._next_notice = 0
        # Times by the clock, ns. Tick 0 is at _start, which is 0 before it is known.
        self._ns = round(period * 1e9)
        self._start = 0
        self.next_time = self._began = self._heard_at = clock()
        self.tick = -1
        self._last = round(scenario.duration / period)
        # How it has ended.
        self.reason: str | None = None
        self._termination = "completed"
        # What is recorded.
        self.measured = Measurements(self, self._last)
        # The log is a CSV file. Each line is written without a buffer, so that it
        # remains if the process is killed.
        self._log = None if log_file is None else FileIO(log_file, "w")

    def Run(self) -> "Side":
        """Runs in real time until the end, SIGINT or SIGTERM; returns the side itself.

        Raises:
            ConnectionError: If the two sides have not been connected.
        """
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        gc.disable()  # A collection takes milliseconds.
        try:
            while self.reason is None:
                time.sleep(max(self.next_time - self._clock(), 0) * 1e-9)
                self.Tick()
        except KeyboardInterrupt:
            self._End("interrupted by the user")
        finally:
            gc.enable()
            signal.signal(signal.SIGTERM, before)
        if not self.measured.ticks:
            raise ConnectionError(f"no connection: {self.reason}")
        return self

    def Tick(self) -> None:
        """Receives packets, computes the tick that is due, and sends a packet."""
        self._Hear()
        now = self._clock()
        if self._start == 0:
            self._Meet(now)
        if self._start > 0:
            self._GoOn(now)
        self._Speak()
        self._WriteLog()
        self.next_time = now + self._ns
        if self._start > 0:
            self.next_time = self._start + (self.tick + 1) * self._ns
        self._EndIfOver(now)

    def _EndIfOver(self, now: int) -> None:
        """Ends the side after its last tick, the other side's end or a long silence."""
        if self._peer_has_ended and (self.trust == 0 or self._start == 0):
            self._End(_OVER)
            return
        if self.tick == self._last:
            self._End("", "completed")
            return
        # The robot's side waits for a caller without a limit.
        is_waiting = self.side == "robot" and self._session.exchanges == 0
        silence = (now - self._heard_at) * 1e-9
        if silence > self._patience and not is_waiting:
            reason = f"nothing was heard for {self._patience:g} s"
            if self._session.exchanges == 0 and self._told:
                reason += f" ({list(self._told.values())[-1]})"
            self._End(reason)

    def _End(self, reason: str, termination: str = "interrupted") -> None:
        """Ends the side: reports it to the other side, and closes socket and log."""
        if self.reason is not None:
            return
        self.reason = reason
        self._termination = termination
        for _ in range(_NUM_FAREWELLS):
            self._Speak()
        self._socket.close()
        if self._log is not None:
            self._log.close()

    def _Hear(self) -> None:
        """Reads and checks the datagrams that have arrived."""
        for _ in range(_MAX_DATAGRAMS):
            try:
                data, address = self._socket.recvfrom(_DATAGRAM_SIZE)
            except OSError:  # No datagram is left.
                return
            now = self._clock()
            opened = self._session.Open(data, address, now)
            if opened.reason is None:
                self._Take(opened.packet, now)
            else:
                self._AnswerRefused(opened.reason, address, now)

    def _Take(self, packet: Any, now: int) -> None:
        """Stores an accepted packet and the packets in use that it reports."""
        self._heard_at = now
        # After its last tick a side is complete, and trust need not fall.
        if packet.ended and packet.tick < self._last:
            self._peer_has_ended = True
        if packet.tick > self._newest.tick:
            self._newest = packet
            self.measured.LatestUsed(self.spoken, packet.tick)[:] = packet.used

    def _AnswerRefused(self, reason: Reason, address: Address, now: int) -> None:
        """Answers a hello, and reports why the two sides cannot connect.

        The address may be forged, so a datagram is answered by one datagram at most.
        """
        is_robot = self.side == "robot"
        if reason == Reason.HELLO and is_robot:
            self._SendTo(address)
        elif reason in (Reason.VERSION, Reason.SCENARIO):
            why = "the other side's version, scenario or options differ"
            self._TellWhyNotHeard(reason, why)
        elif self._session.exchanges > 0:
            return
        elif reason == Reason.HASH and is_robot:
            why = f"packets of {address[0]}:{address[1]} have another key"
            self._TellWhyNotHeard(reason, why)
            # A notice is shorter than any packet, and is not sent more often than this.
            if now >= self._next_notice:
                self._next_notice = now + _NOTICE_PERIOD
                self._Send(WRONG_KEY_NOTICE, address)
        elif reason == Reason.NOTICE and not is_robot:
            why = f"{address[0]}:{address[1]} reports that it has another key"
            self._TellWhyNotHeard(reason, why)

    def _TellWhyNotHeard(self, reason: Reason, why: str) -> None:
        """Reports to the user why the sides cannot connect, once for each reason."""
        if reason not in self._told:
            self._told[reason] = why
            self.Say(f"not heard: {why}")

    def _Meet(self, now: int) -> None:
        """Sets the time of tick 0 once both sides receive each other's packets."""
        if self.side == "robot":
            if self._newest.tick < 0:
                return
            self._start = max(round(self._newest.start - self._session.offset), 1)
        else:
            if self._session.exchanges < _NUM_EXCHANGES:
                return
            self._start = now
        self.next_time = now
        self._began = now - self._ns
        self.Say(f"connected, round trip {self._session.round_trip * 1e-6:.3g} ms")

    def _GoOn(self, now: int) -> None:
        """Advances to the tick that is due; ticks that were missed send nothing."""
        due = min((now - self._start) // self._ns, self._last)
        tick = max(due, self.tick + 1)
        newest = self._newest
        t = tick * self.period
        # The tick of the own packet that the other side had in use when it sent.
        echo = max(newest.used[-1], 0)
        round_trip = float(tick - echo) * self.period
        is_stale = round_trip > self.limit or self._peer_has_ended
        self._TellIfChanged(t, is_stale, round_trip)
        turn = Turn.FALLS if is_stale else Turn.COMES_BACK
        try:
            self.Step(t, newest.values, turn)
        except Exception as error:  # noqa: BLE001 - A law may raise anything.
            self._End(f"{type(error).__name__}: {error}", "diverged")
            return
        measured = Tick(
            tick=tick,
            is_stale=is_stale,
            packet_age=(tick - newest.tick) * self.period,
            round_trip=round_trip,
            period=(now - self._began) * 1e-9,
            lateness=(now - self.next_time) * 1e-9,
            trust=self.trust,
        )
        self.measured.used[self.heard][tick] = newest.tick
        self.tick = tick
        self._began = now
        # Last, so that an interruption leaves no incomplete tick.
        self.measured.ticks.append(measured)

    def _TellIfChanged(self, t: float, is_stale: bool, round_trip: float) -> None:
        """Reports to the user when forces begin to fall or to come back."""
        ticks = self.measured.ticks
        was_stale = bool(ticks) and ticks[-1].is_stale
        if is_stale == was_stale:
            return
        why = f"the newest echo is {round_trip:.3g} s old"
        if self._peer_has_ended:
            why = _OVER
        change = "fall to zero" if is_stale else "come back"
        self.Say(f"t = {t:.3f} s, {why}: forces {change}")

    def _Speak(self) -> None:
        """Sends a packet if the address of the other side is known."""
        if self._session.address is not None:
            self._SendTo(self._session.address)

    def _SendTo(self, address: Address) -> None:
        """Sends a packet."""
        data = self._session.Seal(
            self._clock(),
            self.sent[-1],
            start=self._start,
            tick=self.tick,
            used=self.measured.LatestUsed(self.heard, self.tick),
            ended=self.reason is not None,
        )
        self._Send(data, address)

    def _Send(self, data: bytes, address: Address) -> None:
        """Sends a datagram, which is lost if the socket does not accept it."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, address)

    def _WriteLog(self) -> None:
        """Appends the tick to the log; closes a log that cannot be written.

        The values are measured, received (in use after the tick) and sent.
        """
        if self._log is None or self._start == 0 or self.reason is not None:
            return
        tick = self.measured.ticks[-1]
        row = {"time_s": tick.tick * self.period}
        row |= {f"{name}_s": getattr(tick, name) for name in TIMES}
        row |= {"trust": tick.trust, "tick_of_packet_in_use": self._newest.tick}
        row |= {f"received_{i}": x for i, x in enumerate(self.fed.tolist())}
        row |= {f"sent_{i}": x for i, x in enumerate(self.sent[-1].tolist())}
        text = ",".join(f"{x:.9g}" for x in row.values())
        if len(self.measured.ticks) == 1:
            text = f"{','.join(row)}\n{text}"
        try:
            self._log.write(f"{text}\n".encode("ascii"))
        except OSError as error:
            self.Say(f"the log ends here: {error}")
            self._log.close()
            self._log = None

    def Recording(self) -> TaskRecording:
        """Returns the recording, with one sample for each tick that was not missed.

        Its signals include the fields of a Tick, in s: the age of the packet in use
        (`packet_age`) and of the echo in it (`round_trip`), the time since the tick
        before (`period`) and the lateness (`lateness`); and the trust (`trust`), 0 to
        1.
        """
        time = self.measured.Time()
        signals = self.measured.Signals() | self.Signals(len(time))
        outcome = OutcomeOf(
            self.run,
            self.systems,
            (time, signals, straight_steps(time)),
            max(float(np.ptp(time)), 1e-9),
            Ending(self._termination, self.reason or ""),
        )
        return MakeRecording(self.scenario, self.scenario.simulator, outcome, [])

    def Report(self) -> Record:
        """Returns a summary of the run and its measurements for JSON, times in s."""
        report = {
            "scenario": self.scenario.name,
            "controller": self.scenario.controller.kind,
            "side": self.side,
            "termination": self._termination,
            "reason": self.reason or "",
            "duration_s": round(float(self.measured.Time()[-1]), 9),
            "shortest_round_trip_s": round(self._session.round_trip) / 1e9,
            "refused_packets": dict(self._session.refused),
        }
        return report | self.measured.Report()


def _Agreement(scenario: Scenario, period: float, limit: float, fade: float) -> int:
    """Returns a digest of the settings that both sides must have in common.

    These are the times, the velocity of the operator, and the scenario without its
    name, description, solver and operator.
    """
    others = ("name", "description", "simulator", "surgeon")
    tree = {x: y for x, y in ToTree(scenario).items() if x not in others}
    velocity = list(scenario.surgeon.velocity)
    text = repr((tree, velocity, (period, limit, fade))).encode()
    return int.from_bytes(blake2b(text, digest_size=8).digest(), "big", signed=True)
