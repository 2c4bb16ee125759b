"""One side of the loop over a real network: hears, computes, speaks once a period."""

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

from teleop_drake.link.half import Driver, Half, Turn
from teleop_drake.link.measurements import LogHeader, LogLine, Measurements, Tick
from teleop_drake.link.packets import (
    WRONG_KEY_NOTICE,
    Address,
    FirstPacket,
    Reason,
    Session,
)
from teleop_drake.numerics.step_polynomials import straight_steps
from teleop_drake.recording import Recording
from teleop_drake.scenario import AsTeleoperation, CheckSteps, Scenario, ScenarioLike
from teleop_drake.scenario.tree import ToTree
from teleop_drake.simulation.compiled_run import OutcomeOf
from teleop_drake.simulation.run import Ending
from teleop_drake.simulation.simulate import MakeRecording
from teleop_drake.validation import CheckNumber

# Round trips that are measured before the start.
_NUM_EXCHANGES = 10
_NUM_FAREWELLS = 3
# The most datagrams that are read in a period: a flood takes no longer.
_MAX_DATAGRAMS = 256
_DATAGRAM_SIZE = 2048
# The least time between two notices of a wrong key, ns.
_NOTICE_PERIOD = 1_000_000_000

_OVER = "the other side has ended"

Say = functools.partial(print, "teleop-drake:", file=sys.stderr, flush=True)
"""Prints a line for the user."""


class Side(Half):
    """One side; its tick k is at k periods.

    The robot's side counts from where the operator's tick 0 was by its own clock, if
    both ways of the shortest round trip took half of it. A clock that is off makes one
    way longer and the other one shorter, and changes nothing that is felt.

    Args:
        scenario: Of the whole loop; but for the operator, it is the same on both sides,
            and so are `period`, `limit` and `fade`.
        side: `operator`, which calls, or `robot`, which answers.
        key: The key of both sides (32 bytes).
        end: A socket that never waits.
        address: Where the robot's side is, at the operator's.
        clock: A monotonic one, ns.
        period: Time between packets, s.
        limit: Most age of what is in use, s: since that was sent which the other side
            had in use then. If it is more, trust falls within `fade` s of periods that
            were not missed; see Half.
        fade: In which time trust falls from 1 to 0, and comes back, s.
        patience: After which silence it ends, s.
        say: Takes the lines for the user.
        step: A driver in the place of a simulation, called once a period. When it is no
            longer called, what it drives has to let go by itself.
        log_file: To which each tick is appended; None: to none.

    Attributes:
        next_time: When Tick() is due, by the clock.
        tick: The last one; -1 before the start.
        reason: Why it has ended, empty: it is complete; None while it goes on.
        measured: The ticks, and what was in use at them.
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
        # The newest packet that was heard.
        self._newest = FirstPacket(self.fed)
        self._peer_has_ended = False
        # What the user was told of why the two sides cannot meet.
        self._told: dict[Reason, str] = {}
        self._next_notice = 0
        # Time, by the clock. Tick 0 is at _start; 0: it is not known yet.
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
        self._log: FileIO | None = None
        if log_file is not None:
            self._log = FileIO(log_file, "w")
            self._log.write(LogHeader(self))

    def Run(self) -> "Side":
        """Goes on in real time until the end, by SIGINT or SIGTERM too; returns itself.

        Raises:
            ConnectionError: If the two sides have not met.
        """
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        gc.disable()  # It would take milliseconds.
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
        """Does what is due: hears, computes, speaks."""
        self._Hear()
        now = self._clock()
        if self._start == 0:
            self._Meet(now)
        if self._start > 0:
            self._GoOn(now)
        self._Speak()
        self._WriteLog()
        start = self._start or now + self._ns
        self.next_time = start + (self.tick + 1) * self._ns
        self._EndIfOver(now)

    def _EndIfOver(self, now: int) -> None:
        """Ends after the last tick, after the other side has ended, or in silence."""
        if self._peer_has_ended and (self.trust == 0 or self._start == 0):
            self._End(_OVER)
            return
        if self.tick == self._last:
            self._End("", "completed")
            return
        # The robot's side waits for a caller for as long as it takes.
        is_waiting = self.side == "robot" and self._session.exchanges == 0
        silence = (now - self._heard_at) * 1e-9
        if silence > self._patience and not is_waiting:
            reason = f"nothing was heard for {self._patience:g} s"
            if self._session.exchanges == 0 and self._told:
                reason += f" ({list(self._told.values())[-1]})"
            self._End(reason)

    def _End(self, reason: str, termination: str = "interrupted") -> None:
        """Sends farewells and closes the socket, unless it has ended."""
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
        """Opens the datagrams that have come."""
        for _ in range(_MAX_DATAGRAMS):
            try:
                data, address = self._socket.recvfrom(_DATAGRAM_SIZE)
            except OSError:  # None is left.
                return
            now = self._clock()
            opened = self._session.Open(data, address, now)
            if opened.reason is None:
                self._Take(opened.packet, now)
            else:
                self._AnswerRefused(opened.reason, address, now)

    def _Take(self, packet: Any, now: int) -> None:
        """Takes note of a packet that is believed."""
        self._heard_at = now
        # A side that is complete is no loss.
        if packet.ended and packet.tick < self._last:
            self._peer_has_ended = True
        if packet.tick > self._newest.tick:
            self._newest = packet
            self.measured.LatestUsed(self.spoken, packet.tick)[:] = packet.used

    def _AnswerRefused(self, reason: Reason, address: Address, now: int) -> None:
        """Answers a hello, and reports why the two sides cannot meet.

        A caller may be forged: what is sent is no more than what has come.
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
            # At most so often, and shorter than any packet.
            if now >= self._next_notice:
                self._next_notice = now + _NOTICE_PERIOD
                self._Send(WRONG_KEY_NOTICE, address)
        elif reason == Reason.NOTICE and not is_robot:
            why = f"{address[0]}:{address[1]} reports that it has another key"
            self._TellWhyNotHeard(reason, why)

    def _TellWhyNotHeard(self, reason: Reason, why: str) -> None:
        """Tells the user why the two sides cannot meet; once for each reason."""
        if reason not in self._told:
            self._told[reason] = why
            self.Say(f"not heard: {why}")

    def _Meet(self, now: int) -> None:
        """Sets tick 0 if both sides hear each other."""
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
        """Goes on to the tick that is due; those that were missed send nothing."""
        due = min((now - self._start) // self._ns, self._last)
        tick = max(due, self.tick + 1)
        newest = self._newest
        t = tick * self.period
        # The tick of what the other side had in use then.
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
        # This is last: whatever interrupts, there is nothing that is half done.
        self.measured.ticks.append(measured)

    def _TellIfChanged(self, t: float, is_stale: bool, round_trip: float) -> None:
        """Tells the user that forces fall, or come back."""
        ticks = self.measured.ticks
        was_stale = bool(ticks) and ticks[-1].is_stale
        if is_stale == was_stale:
            return
        why = f"what is heard is {round_trip:.3g} s old"
        if self._peer_has_ended:
            why = _OVER
        so = "fall to zero" if is_stale else "come back"
        self.Say(f"t = {t:.3f} s, {why}: forces {so}")

    def _Speak(self) -> None:
        """Sends a packet, if it is known where to."""
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
        """Sends a datagram; one that is not taken is lost."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, address)

    def _WriteLog(self) -> None:
        """Appends the tick to the log; goes on without one that cannot be written."""
        if self._log is None or self._start == 0 or self.reason is not None:
            return
        try:
            tick = self.measured.ticks[-1]
            self._log.write(LogLine(self, tick, self._newest.tick))
        except OSError as error:
            self.Say(f"the log ends here: {error}")
            self._log.close()
            self._log = None

    def Recording(self) -> Recording:
        """Returns the signals each period.

        They include the age in s of what was in use (`packet_age`), of the echo in it
        (`round_trip`), how long after the one before a period began (`period`), how
        late (`lateness`), and how far what was in use was trusted, 0 to 1 (`trust`).
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

    def Report(self) -> dict[str, Any]:
        """Returns what was measured, times in s, as JSON has it."""
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
    """Returns all that both sides have in common as a number: not the operator."""
    others = ("name", "description", "simulator", "surgeon")
    tree = {x: y for x, y in ToTree(scenario).items() if x not in others}
    velocity = list(scenario.surgeon.velocity)
    text = repr((tree, velocity, (period, limit, fade))).encode()
    return int.from_bytes(blake2b(text, digest_size=8).digest(), "big", signed=True)
