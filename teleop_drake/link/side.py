"""One side of the loop over a real network: hears, computes, speaks once a period."""

import gc
import math
import signal
import sys
import time
from collections.abc import Callable
from hashlib import blake2b
from typing import Any

import numpy as np

from teleop_drake.link import packets
from teleop_drake.link.halves import WAYS, Half
from teleop_drake.link.packets import Array, ReadKey, Session, Udp
from teleop_drake.recording import Recording, SolverStatistics
from teleop_drake.scenario import AsTeleoperation, CheckSteps, Scenario, ScenarioLike
from teleop_drake.scenario.tree import ToTree
from teleop_drake.signals import AxesOf
from teleop_drake.validation import CheckNumber, Refuse

# Round trips that are measured before the start, and farewells.
_NUM_EXCHANGES, _NUM_FAREWELLS = 10, 3

# Parts of a packet that are held where nothing is heard: positions and energies.
# Forces, velocities, accelerations and waves fall to zero.
_HELD = ("p", "x", "E")


def Say(line: str) -> None:
    """Tells the user a line."""
    print(f"teleop-drake: {line}", file=sys.stderr, flush=True)


def Parts(scenario: Scenario, way: str) -> list[tuple[str, str]]:
    """Returns the name and the axis of each number that a packet may have."""
    parts = getattr(scenario.controller.Chosen(), f"{way}_parts")
    return [(part, axis) for part in parts for axis in AxesOf(scenario.num_axes)]


class Side:
    """One side; its tick k is at k periods.

    The robot's side counts from where the operator's tick 0 was by its own clock, if
    both ways of the shortest round trip took half of it. A clock that is off makes one
    way longer and the other one shorter, and changes nothing that is felt.

    Args:
        scenario: Of the whole loop.
        side: `operator`, which calls, or `robot`, which answers.
        transport: As Udp.
        clock: A monotonic clock, ns.
        step: In the place of a simulation: takes the time in s and the packet that is
            in use, and returns what to send, once a period. When it is no longer
            called, what it drives has to let go by itself.
        period: Time between packets, s; the same on both sides.
        limit: Most age of what is in use, s: since that was sent which the other side
            had in use then. The round trip has to be less. If it is more, forces fall
            to zero within `fade`, and so they come back; periods that were missed do
            not count.
        patience: After which silence it ends, s.
        own: Systems of one's own, as MakeTeleoperator() takes them; no channels.

    Attributes:
        next_time: When Tick() is due, by the clock.
        reason: Why it has ended, empty: it is complete; None while it goes on.
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        side: str,
        key: bytes,
        transport: Any,
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
        self.side, (self._heard, self._spoken) = side, WAYS[side]
        self._half = Half(scenario, side, own)
        self._step, self.initial = step or self._half, self._half.initial
        self._fed = self.initial[self._heard]
        size = self._fed.size
        names = [name for name, _ in Parts(scenario, self._heard)[:size]]
        if len(names) < size:
            allowed = f"one that has {self._heard}_parts, so that its forces can fall"
            Refuse("controller.kind", scenario.controller.kind, allowed)
        self._falls = np.array([not name.startswith(_HELD) for name in names])
        role, agreement = int(side == "robot"), _Agreement(scenario, period)
        address = None if role else transport.address
        self._session = Session(key, role, agreement, size, address)
        self.Say, self._transport, self._clock = say, transport, clock
        self.period, self._period_ns = period, round(period * 1e9)
        self._limit, self._patience = limit, patience
        self._num_fading = math.ceil(fade / period)
        self._last_tick = round(scenario.duration / period)
        self.next_time = self._heard_at = clock()
        self.reason: str | None = None
        self._termination, self._start = "completed", 0
        self._newest = packets.NOTHING._replace(values=self._fed)
        # `_fading` periods are left until it is followed, or forces are zero.
        self._fading, self._is_stale, self._peer_has_ended = 0, False, False
        # The ticks of what was in use at all ticks, here and there.
        self._used: list[int] = []
        self._peer_used: dict[int, int] = {}
        self._rows: list[tuple[int, ...]] = []
        self._packets: list[tuple[Array, Array]] = []

    def Run(self) -> "Side":
        """Goes on in real time until the end, by SIGINT or SIGTERM too; returns itself.

        Raises:
            ConnectionError: If the two sides have not met.
        """

        def End(number: int, frame: Any) -> None:
            self._End(f"ended by {signal.Signals(number).name}", "interrupted")

        numbers = signal.SIGINT, signal.SIGTERM
        before = [signal.signal(number, End) for number in numbers]
        gc.disable()  # It would take milliseconds.
        try:
            while self.reason is None:
                time.sleep(max(self.next_time - self._clock(), 0) * 1e-9)
                self.Tick()
        finally:
            gc.enable()
            for number, handler in zip(numbers, before, strict=True):
                signal.signal(number, handler)
            self.Close()
        if not self._packets:
            raise ConnectionError(f"no connection: {self.reason}")
        return self

    def Close(self) -> None:
        """Says farewell."""
        for _ in range(_NUM_FAREWELLS):
            self._Speak(self.initial[self._spoken], packets.ENDED)
        self._transport.Close()

    def Tick(self) -> None:
        """Does what is due: hears, computes, speaks."""
        self._Hear()
        now = self._clock()
        if self._start or self._Meets(now):
            self._GoOn(now)
        else:
            self._Speak(self.initial[self._spoken], packets.WAITING)
            self.next_time = now + self._period_ns
            if self.side == "robot":  # It waits for as long as it takes.
                self._heard_at = now
        has_let_go = self._is_stale and not self._fading
        if self._peer_has_ended and (has_let_go or not self._start):
            self._End("the other side has ended", "interrupted")
        elif len(self._used) > self._last_tick:
            self._End("", "completed")
        elif (now - self._heard_at) * 1e-9 > self._patience:
            self._End(f"nothing was heard for {self._patience:g} s", "interrupted")

    def _Hear(self) -> None:
        """Takes what has come."""
        datagrams, now = self._transport.Receive(), self._clock()
        refused, strange = self._session.refused, ("version", "scenario")
        told = any(refused[x] for x in strange)
        for data, address in datagrams:
            packet = self._session.Open(data, now, address)
            if packet is None:
                continue
            self._heard_at = now
            # One that is complete is no loss.
            is_early = packet.tick < self._last_tick
            self._peer_has_ended |= packet.state == packets.ENDED and is_early
            if packet.tick > self._newest.tick and packet.state == packets.RUNNING:
                self._newest = packet
                ticks = range(packet.tick, -1, -1)
                self._peer_used.update(zip(ticks, packet.used, strict=False))
        if not told and any(refused[x] for x in strange):
            self.Say("not heard: the other side's version, scenario or period differ")

    def _Meets(self, now: int) -> bool:
        """Returns whether both sides hear each other, and sets tick 0."""
        session = self._session
        if self.side == "robot" and self._newest.tick >= 0:
            self._start = max(round(self._newest.start - session.offset), 1)
        elif self.side == "operator" and session.num_exchanges >= _NUM_EXCHANGES:
            self._start = now
        if self._start:
            self.next_time = now
            self.Say(f"connected, round trip {session.round_trip * 1e-6:.3g} ms")
        return self._start > 0

    def _GoOn(self, now: int) -> None:
        """Goes on to the tick that is due; those that were missed send nothing."""
        due = min((now - self._start) // self._period_ns, self._last_tick)
        missed = due - len(self._used)
        self._used += (self._used[-1:] or [-1]) * missed + [self._newest.tick]
        tick, echo = len(self._used) - 1, max(self._newest.used[0], 0)
        t, size = tick * self.period, self.initial[self._spoken].size
        self._Follow(t, (tick - echo) * self.period)
        try:
            values = np.array(self._step(t, self._fed), float)
            if values.shape != (size,) or not np.isfinite(values).all():
                raise ArithmeticError(f"must send {size} finite numbers, not {values}")
        except Exception as error:
            self._End(f"{type(error).__name__}: {error}", "diverged")
            return
        ages = tick - self._newest.tick, tick - echo
        self._rows.append((tick, now, now - self.next_time, *ages, self._is_stale))
        self._packets.append((self._fed, values))
        self._Speak(values, packets.RUNNING)
        self.next_time = self._start + (tick + 1) * self._period_ns

    def _Follow(self, t: float, age: float) -> None:
        """Takes the newest packet, or lets forces fall if what is in use is too old."""
        is_stale = age > self._limit or self._peer_has_ended
        if is_stale != self._is_stale:
            self._is_stale, self._fading = is_stale, self._num_fading
            line = "it is heard again: forces come back"
            if is_stale:
                why = f"what is heard is {age:.3g} s old, more than {self._limit:g} s"
                why = "the other side has ended" if self._peer_has_ended else why
                line = f"{why}: forces fall to zero"
            self.Say(f"t = {t:.3f} s: {line}")
        held = np.where(self._falls, 0.0, self._fed)
        target = held if is_stale else self._newest.values
        self._fading = max(self._fading - 1, 0)
        part = (target - self._fed) / (self._fading + 1)
        self._fed = self._fed + part if self._fading else target

    def _Speak(self, values: Array, state: int) -> None:
        """Sends a packet, if it is known where to."""
        if self._session.address:
            now, start, used = self._clock(), self._start, self._used
            data = self._session.Seal(now, state, start, used, values)
            self._transport.Send(data, self._session.address)

    def _End(self, reason: str, termination: str) -> None:
        """Ends the side, unless it has ended."""
        if self.reason is None:
            self.reason, self._termination = reason, termination

    def Recording(self) -> Recording:
        """Returns the signals each period.

        They include the age in s of what was in use (`packet_age`), and of the echo in
        it (`round_trip`).
        """
        ticks, woken, _, ages, trips, _ = np.array(self._rows).T
        fed, sent = map(np.array, zip(*self._packets, strict=True))
        is_simulated = self._step is self._half
        steps, evaluations = self._half.Counts()
        seconds = max(float(woken[-1] - woken[0]) * 1e-9, self.period)
        return Recording(
            scenario=self.scenario,
            time=ticks * self.period,
            signals={
                f"{self._heard}_packet_received": fed,
                f"{self._spoken}_packet_sent": sent,
                **(self._half.Signals() if is_simulated else {}),
                "packet_age": ages[:, np.newaxis] * self.period,
                "round_trip": trips[:, np.newaxis] * self.period,
            },
            events=[],
            solver=SolverStatistics(
                engine="compiled" if is_simulated else "step",
                scheme=self.scenario.simulator.integration_scheme,
                accuracy=self.scenario.simulator.accuracy,
                steps=steps,
                derivative_evaluations=evaluations,
                wall_time_s=seconds,
                real_time_factor=float(ticks[-1]) * self.period / seconds,
            ),
            termination=self._termination,
            reason=self.reason or "",
        )

    def Delays(self) -> dict[str, Array]:
        """Returns how long each packet took until it was in use, s; NaN: it never was.

        Returns:
            By `forward` and `return`; entry k is of the packet of tick k. It is less
            than 0 if clocks have drifted so far that it was in use before its tick.
        """
        used = {self._heard: dict(enumerate(self._used)), self._spoken: self._peer_used}
        num = len(self._used)
        delays = {way: np.full(num, np.nan) for way in ("forward", "return")}
        for way, values in delays.items():
            for tick, packet in sorted(used[way].items(), reverse=True):
                if 0 <= packet < num:  # The first tick counts.
                    values[packet] = self.period * (tick - packet)
        return delays

    def Report(self) -> dict[str, Any]:
        """Returns what was measured, times in s, as JSON has it."""
        ticks, woken, late, _, trips, stale = np.array(self._rows).T
        periods = np.diff(woken, append=woken[-1] + self._period_ns) * 1e-9
        known = self._peer_used
        span = max(known, default=-1) + 1 - min(known, default=0)
        changes = np.flatnonzero(np.diff(stale, prepend=0, append=0))
        changes = ticks[np.minimum(changes, len(ticks) - 1)].reshape(-1, 2)
        delays = self.Delays().items()
        return {
            "scenario": self.scenario.name,
            "controller": self.scenario.controller.kind,
            "side": self.side,
            "termination": self._termination,
            "reason": self.reason,
            "duration": float(ticks[-1]) * self.period,
            "period": self.period,
            "mean_period": float(periods.mean()),
            "jitter": float(periods.std()),
            "largest_lateness": float(late.max()) * 1e-9,
            "missed_periods": int(ticks[-1] - ticks[0]) + 1 - len(ticks),
            "round_trip": {
                "shortest": self._session.round_trip * 1e-9,
                "median": float(np.median(trips)) * self.period,
                "longest": float(trips.max()) * self.period,
            },
            "unused_packets": {way: int(np.isnan(x).sum()) for way, x in delays},
            "early_packets": {way: int((x < 0).sum()) for way, x in delays},
            "unknown_periods": span - len(known),
            "refused_packets": dict(self._session.refused),
            "outages": (changes * self.period).tolist(),
        }


def _Agreement(scenario: Any, period: float) -> int:
    """Returns all that both sides have in common as a number: not the operator."""
    tree = ToTree(scenario) | {"surgeon": list(scenario.surgeon.velocity)}
    tree = {x: tree[x] for x in tree if x not in ("name", "description", "simulator")}
    digest = blake2b(repr((tree, period)).encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little", signed=True)


def OperateRemotely(
    scenario: ScenarioLike, *, connect: str, key: str, **options: Any
) -> Side:
    """Runs the operator's side: the operator, the device and the master side.

    Args:
        scenario: Of the whole loop; the same on both sides, but for the operator.
        connect: HOST:PORT of the robot's side.
        key: A file that `serve --new-key FILE` wrote, the same on both sides.
        options: See Side.

    Returns:
        The side after its end: its Recording(), Delays() and Report().
    """
    transport = Udp(connect, listens=False)
    return Side(scenario, "operator", ReadKey(key), transport, **options).Run()


def ServeRobot(
    scenario: ScenarioLike, *, listen: str, key: str, **options: Any
) -> Side:
    """Runs the robot's side, as OperateRemotely() the other one; waits until it calls.

    Args:
        listen: HOST:PORT of this machine.
    """
    transport = Udp(listen, listens=True)
    side = Side(scenario, "robot", ReadKey(key), transport, **options)
    side.Say("listening at {}:{}".format(*transport.address[:2]))
    return side.Run()
