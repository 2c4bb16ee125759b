"""One side of the loop over a real network: hears, computes, speaks once a period."""

import functools
import gc
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from types import SimpleNamespace
from typing import Any

import numpy as np

from teleop_drake.link import packets
from teleop_drake.link.halves import WAYS, Half
from teleop_drake.link.packets import NUM_USED, Array, Session
from teleop_drake.recording import Recording
from teleop_drake.scenario import AsTeleoperation, CheckSteps, ScenarioLike
from teleop_drake.scenario.tree import ToTree
from teleop_drake.validation import CheckNumber, Refuse

# Round trips that are measured before the start, farewells, and the most datagrams that
# are read in a period: a flood takes no longer.
_NUM_EXCHANGES, _NUM_FAREWELLS, _MAX_DATAGRAMS = 10, 3, 256
_OVER = "the other side has ended"

Say = functools.partial(print, "teleop-drake:", file=sys.stderr, flush=True)
"""Tells the user a line."""


class Side:
    """One side; its tick k is at k periods.

    The robot's side counts from where the operator's tick 0 was by its own clock, if
    both ways of the shortest round trip took half of it. A clock that is off makes one
    way longer and the other one shorter, and changes nothing that is felt.

    Args:
        scenario: Of the whole loop; but for the operator, it is the same on both sides,
            and so are `period`, `limit` and `fade`.
        side: `operator`, which calls, or `robot`, which answers.
        end: A socket; `address`: of the robot's side, at the operator's.
        clock: A monotonic one, ns.
        step: In the place of a simulation: takes the time in s and the packet that is
            in use, and returns what to send, once a period. When it is no longer
            called, what it drives has to let go by itself.
        period: Time between packets, s.
        limit: Most age of what is in use, s: since that was sent which the other side
            had in use then. If it is more, trust falls within `fade` s of periods that
            were not missed; see Half.
        patience: After which silence it ends, s.
        own: Systems of one's own, as MakeTeleoperator() takes them; no channels.

    Attributes:
        next_time: When Tick() is due, by the clock.
        reason: Why it has ended, empty: it is complete; None while it goes on.
        tick: The last one; -1 before the start.
        log: Of each tick, after NUM_USED rows: `turn`, 1 if what was in use was too
            old, else -1 (0: it was missed), `late` in ns, `trust`, what was fed, sent.
        used: Of each way, after NUM_USED rows, the tick of the packet that was in use
            at each tick where it is heard; -1: none, or it was missed; -2: not known.
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        side: str,
        key: bytes,
        end: Any,
        address: Any = None,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        step: Callable[[float, Array], Any] | None = None,
        period: float = 0.001,
        limit: float = 0.5,
        fade: float = 0.1,
        patience: float = 5.0,
        say: Callable[[str], None] = Say,
        **own: Any,
    ):
        self.scenario = scenario = AsTeleoperation(scenario)
        CheckSteps(scenario)
        CheckNumber("period", period, "s", minimum=1e-4)
        for name, time_s in (("limit", limit), ("fade", fade), ("patience", patience)):
            CheckNumber(name, time_s, "s", above=0)
        for name in {"architecture", "forward_channel", "return_channel"} & own.keys():
            Refuse(name, own[name], "left out: the network is the scenario's channel")
        self.side, (self.heard, self.spoken) = side, WAYS[side]
        self.period, self._ns, self.limit = period, round(period * 1e9), limit
        self.num_fading, self._patience = int(np.ceil(fade / period)), patience
        self._half = Half(scenario, side, period, self.num_fading, own)
        self._step, self._socket, self._clock, self.Say = step, end, clock, say
        heard, spoken = (self._half.initial[way] for way in WAYS[side])
        role, agreement = side == "robot", _Agreement(scenario, period, limit, fade)
        self._session = Session(key, role, agreement, heard.size, address)
        self.next_time = self._heard_at = clock()
        self.reason: str | None = None
        self._termination, self._start, self.tick = "completed", 0, -1
        self._newest: Any = SimpleNamespace(tick=-1, used=[-1], values=heard)
        self._is_stale = self._peer_has_ended = self._is_told = False
        self._last = round(scenario.duration / period)
        fields: Any = [("used", int), ("turn", int), ("late", float), ("trust", float)]
        fields += [("fed", float, heard.shape), ("sent", float, spoken.shape)]
        self.log = np.zeros(NUM_USED + self._last + 1, fields)
        self.log["used"], self.log["sent"] = -1, spoken
        peer = np.full(len(self.log), -2)
        self.used = {self.heard: self.log["used"], self.spoken: peer}

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
        if self.tick < 0:
            raise ConnectionError(f"no connection: {self.reason}")
        return self

    def Tick(self) -> None:
        """Does what is due: hears, computes, speaks."""
        self._Hear()
        now = self._clock()
        if self._start or self._Meets(now):
            self._GoOn(now)
        self._Speak()
        due = self._start + (self.tick + 1) * self._ns
        self.next_time = due if self._start else now + self._ns
        # The robot's side waits for as long as it takes.
        is_waiting = self.side == "robot" and not self._start
        if self._peer_has_ended and (self._half.trust == 0 or not self._start):
            self._End(_OVER)
        elif self.tick == self._last:
            self._End("", "completed")
        elif (now - self._heard_at) * 1e-9 > self._patience and not is_waiting:
            self._End(f"nothing was heard for {self._patience:g} s")

    def _End(self, reason: str, termination: str = "interrupted") -> None:
        """Says farewell, unless it has ended."""
        if self.reason is None:
            self.reason, self._termination = reason, termination
            for _ in range(_NUM_FAREWELLS):
                self._Speak()
            self._socket.close()

    def _Hear(self) -> None:
        """Takes what has come."""
        refused = self._session.refused
        with suppress(OSError):  # None is left.
            for _ in range(_MAX_DATAGRAMS):
                data, address = self._socket.recvfrom(2048)
                now = self._clock()
                packet = self._session.Open(data, address, now)
                if packet is None:
                    continue
                self._heard_at = now
                # One that is complete is no loss.
                is_early = packet.tick < self._last
                self._peer_has_ended |= bool(packet.ended) and is_early
                if packet.tick > self._newest.tick:
                    self._newest = packet
                    self.used[self.spoken][packet.tick + 1 :][:NUM_USED] = packet.used
        if not self._is_told and (refused["version"] or refused["scenario"]):
            self.Say("not heard: the other side's version, scenario or options differ")
            self._is_told = True

    def _Meets(self, now: int) -> bool:
        """Returns whether both sides hear each other, and sets tick 0."""
        session = self._session
        if self.side == "robot" and self._newest.tick >= 0:
            self._start = max(round(self._newest.start - session.offset), 1)
        elif self.side == "operator" and session.exchanges >= _NUM_EXCHANGES:
            self._start = now
        if self._start:
            self.next_time = now
            self.Say(f"connected, round trip {session.round_trip * 1e-6:.3g} ms")
        return self._start > 0

    def _GoOn(self, now: int) -> None:
        """Goes on to the tick that is due; those that were missed send nothing."""
        due = min((now - self._start) // self._ns, self._last)
        tick, newest, row = max(due, self.tick + 1), self._newest, self.log["sent"][-1]
        t, age = tick * self.period, (tick - max(newest.used[-1], 0)) * self.period
        is_stale = age > self.limit or self._peer_has_ended
        if is_stale != self._is_stale:
            why = _OVER if self._peer_has_ended else f"what is heard is {age:.3g} s old"
            so = "fall to zero" if is_stale else "come back"
            self.Say(f"t = {t:.3f} s, {why}: forces {so}")
        self._is_stale, turn = is_stale, 1 if is_stale else -1
        before, packet = self._half.fed, self._half.Follow(newest.values, turn)
        try:
            values = self._step(t, packet) if self._step else self._half.Advance(t)
            values = np.array(values, float)
            if values.shape != row.shape or not np.isfinite(values).all():
                wanted = f"must send {row.size} finite numbers"
                raise ArithmeticError(f"{wanted}, not {values}")
        except Exception as error:
            self._End(f"{type(error).__name__}: {error}", "diverged")
            return
        if not self._step:
            self._half.Feed()
        trust, late, self.tick = self._half.trust, now - self.next_time, tick
        self.log[NUM_USED + tick] = newest.tick, turn, late, trust, before, values

    def _Speak(self) -> None:
        """Sends a packet, if it is known where to; one that is not taken is lost."""
        if address := self._session.address:
            rows, ended = self.log[self.tick + 1 :][:NUM_USED], self.reason is not None
            state = self._start, self.tick, ended, rows["used"], rows["sent"][-1]
            data = self._session.Seal(self._clock(), *state)
            with suppress(OSError):
                self._socket.sendto(data, address)

    def Recording(self) -> Recording:
        """Returns the signals each period.

        They include the age in s of what was in use (`packet_age`), of the echo in it
        (`round_trip`), how late a period began (`lateness`), and how far what was in
        use was trusted, 0 to 1 (`trust`).
        """
        rows = np.flatnonzero(self.log["turn"])
        log, ticks = self.log[rows], rows - NUM_USED
        echoes = self.used[self.spoken][NUM_USED + log["used"]].clip(0)
        measured = {
            "packet_age": (ticks - log["used"]) * self.period,
            "round_trip": (ticks - echoes) * self.period,
            "lateness": log["late"] * 1e-9,
            "trust": log["trust"],
        }
        signals = {name: x[:, np.newaxis] for name, x in measured.items()}
        signals[f"{self.heard}_packet_received"] = log["fed"]
        signals[f"{self.spoken}_packet_sent"] = log["sent"]
        ending = self._termination, self.reason or ""
        return self._half.Recording(ticks * self.period, signals, *ending)

    def Delays(self) -> dict[str, Array]:
        """Returns how long each packet took until it was in use, s; NaN: it never was.

        Returns:
            By `forward` and `return`; entry k is of the packet of tick k. It is less
            than 0 if clocks have drifted so far that it was in use before its tick.
        """
        delays, num = {}, self.tick + 1
        for way, used in self.used.items():
            packets, ticks = np.unique(used[NUM_USED:][:num], return_index=True)
            known = (packets >= 0) & (packets < num)
            delays[way] = np.full(num, np.nan)
            delays[way][packets[known]] = self.period * (ticks - packets)[known]
        return delays

    def Report(self) -> dict[str, Any]:
        """Returns what was measured, times in s, as JSON has it."""
        run, delays = self.Recording(), self.Delays()
        time, late, trips = run.time, run["lateness"][:, 0], run["round_trip"]
        woken = np.append(time[:1], time[:-1] + self.period) + late
        periods = np.diff(woken, append=woken[-1] + self.period)
        turns, peer = self.log["turn"][NUM_USED:], self.used[self.spoken][NUM_USED:]
        turns = turns[: self.tick + 1]
        changes = np.flatnonzero(np.diff(turns[turns != 0], prepend=-1, append=-1))
        outages = np.append(time, time[-1])[changes].reshape(-1, 2)
        numbers = {
            "duration": time[-1],
            "period": self.period,
            "mean_period": periods.mean(),
            "jitter": periods.std(),
            "largest_lateness": late.max(),
            "shortest_round_trip": self._session.round_trip * 1e-9,
            "median_round_trip": np.median(trips),
            "longest_round_trip": trips.max(),
        }
        return {
            "scenario": self.scenario.name,
            "controller": self.scenario.controller.kind,
            "side": self.side,
            "termination": run.termination,
            "reason": run.reason,
            **{name: float(f"{x:.6g}") for name, x in numbers.items()},
            "missed_periods": int(turns.size - len(time) - np.argmax(turns != 0)),
            "unused_packets": {x: int(np.isnan(y).sum()) for x, y in delays.items()},
            "early_packets": {x: int((y < 0).sum()) for x, y in delays.items()},
            "unknown_periods": int(np.sum(np.diff(np.flatnonzero(peer > -2)) - 1)),
            "refused_packets": dict(self._session.refused),
            "outages": outages.round(6).tolist(),
        }


def _Agreement(scenario: Any, *numbers: float) -> int:
    """Returns all that both sides have in common as a number: not the operator."""
    others = "name", "description", "simulator", "surgeon"
    tree = {x: y for x, y in ToTree(scenario).items() if x not in others}
    text = repr((tree, list(scenario.surgeon.velocity), numbers)).encode()
    return int.from_bytes(blake2b(text, digest_size=8).digest(), "big", signed=True)


def OperateRemotely(
    scenario: ScenarioLike, *, connect: str, key: str, **more: Any
) -> Side:
    """Runs the operator's side: the operator, the device and the master side.

    Args:
        connect: HOST:PORT of the robot's side.
        key: A file that `serve --new-key FILE` wrote, the same on both sides.
        more: Options of Side; there is the scenario, too.

    Returns:
        The side after its end: its Recording(), Delays() and Report().
    """
    end, address = packets.OpenSocket(connect, listens=False)
    return Side(scenario, "operator", packets.ReadKey(key), end, address, **more).Run()


def ServeRobot(scenario: ScenarioLike, *, listen: str, key: str, **more: Any) -> Side:
    """Runs the robot's side at HOST:PORT; waits until OperateRemotely() calls."""
    end, _ = packets.OpenSocket(listen, listens=True)
    side = Side(scenario, "robot", packets.ReadKey(key), end, **more)
    side.Say("listening at {}:{}".format(*end.getsockname()[:2]))
    return side.Run()
