"""One side of the loop over a real network: hears, computes, speaks once a period."""

import gc
import signal
import sys
import time
from collections.abc import Callable, Sequence
from hashlib import blake2b
from typing import Any

import numpy as np

from teleop_drake.link.halves import WAYS, Half
from teleop_drake.link.packets import (
    ENDED,
    RUNNING,
    WAITING,
    Array,
    ReadKey,
    Session,
    Udp,
)
from teleop_drake.recording import Recording, SolverStatistics
from teleop_drake.scenario import AsTeleoperation, CheckSteps, ScenarioLike
from teleop_drake.scenario.tree import ToTree
from teleop_drake.validation import CheckNumber, Refuse

# Round trips that are measured before the start, and farewells.
_NUM_EXCHANGES, _NUM_FAREWELLS = 10, 3

# Parts of a packet that are held where nothing is heard: positions and energies.
# Forces, velocities, accelerations and waves fall to zero.
_HELD = ("p", "x", "E")


def Say(line: str) -> None:
    """Tells the user a line."""
    print(f"teleop-drake: {line}", file=sys.stderr, flush=True)


class Side:
    """One side; its tick k is at k periods.

    The robot's side counts from where the operator's tick 0 was by its own clock, if
    both ways of the shortest round trip took half of it. A clock that is off makes one
    way longer and the other one shorter, and changes nothing that is felt.

    Args:
        scenario: Of the whole loop.
        side: `operator`, which calls, or `robot`, which answers.
        key: The secret of both sides.
        transport: As Udp.
        clock: A monotonic clock, ns.
        step: In the place of a simulation: takes the time in s and the packet that is
            in use, and returns what to send, once a period. When it is no longer
            called, what it drives has to let go by itself.
        period: Time between packets, s; the same on both sides.
        limit: Most age of what is in use, s: since that was sent which the other side
            had in use then. The round trip has to be less. If it is more, forces fall
            to zero within `fade`, and so they come back.
        patience: After which silence it ends, s.
        say: Takes lines for the user.
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
        self._in_use = self._fed = self._safe = self.initial[self._heard]
        parts = getattr(scenario.controller.Chosen(), f"{self._heard}_parts")
        falls = [not part.startswith(_HELD) for part in parts]
        self._falls = np.repeat(falls, scenario.num_axes)[: self._fed.size]
        if self._falls.size < self._fed.size:
            allowed = f"one that has {self._heard}_parts, so that its forces can fall"
            Refuse("controller.kind", scenario.controller.kind, allowed)
        role, self._transport, self._clock = int(side == "robot"), transport, clock
        agreement = _Agreement(scenario, period)
        address = None if role else transport.address
        self._session = Session(key, role, agreement, self._fed.size, address)
        self.Say, self.period, self._limit, self._fade = say, period, limit, fade
        self._patience, self._last_tick = patience, round(scenario.duration / period)
        self.next_time = self._heard_at = clock()
        self.reason: str | None = None
        self._termination, self._start, self._tick = "completed", 0, -1
        # Of what was heard: its tick, what the other side had in use, its tick 0.
        self._heard_tick, self._echo, self._peer_start = -1, 0, 0
        self._share, self._is_stale, self._peer_has_ended = 1.0, False, False
        self._used: list[int] = []
        self._peer_used: dict[int, int] = {}
        self._rows: list[tuple[int, ...]] = []
        self._packets: list[tuple[Array, Array]] = []
        self._outages: list[list[float]] = []

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
            self._Speak(self.initial[self._spoken], ENDED)
        self._transport.Close()

    def Tick(self) -> None:
        """Does what is due: hears, computes, speaks."""
        self._Hear()
        now = self._clock()
        if self._start or self._Meets(now):
            self._GoOn(now)
        else:
            self._Speak(self.initial[self._spoken], WAITING)
            self.next_time = now + round(self.period * 1e9)
            if self.side == "robot":  # It waits for as long as it takes.
                self._heard_at = now
        if self._peer_has_ended and (self._share == 0 or not self._start):
            self._End("the other side has ended", "interrupted")
        elif self._tick == self._last_tick:
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
            self._peer_has_ended |= packet.state == ENDED and is_early
            if packet.tick > self._heard_tick and packet.state == RUNNING:
                self._heard_tick, self._in_use = packet.tick, packet.values
                self._peer_start, self._echo = packet.start, max(packet.used[0], 0)
                for i, used in enumerate(packet.used):
                    self._peer_used.setdefault(packet.tick - i, used)
        if not told and any(refused[x] for x in strange):
            self.Say("not heard: the other side's version, scenario or period differ")

    def _Meets(self, now: int) -> bool:
        """Returns whether both sides hear each other, and sets tick 0."""
        session = self._session
        if self.side == "robot" and self._heard_tick >= 0:
            self._start = max(round(self._peer_start - session.offset), 1)
        elif self.side == "operator" and session.num_exchanges >= _NUM_EXCHANGES:
            self._start = now
        if self._start:
            self.next_time = now
            self.Say(f"connected, round trip {session.round_trip * 1e-6:.3g} ms")
        return self._start > 0

    def _GoOn(self, now: int) -> None:
        """Goes on to the tick that is due; those that were missed send nothing."""
        before, period_ns = self._tick, round(self.period * 1e9)
        due = max(before + 1, (now - self._start) // period_ns)
        tick = self._tick = min(due, self._last_tick)
        t, passed = tick * self.period, (tick - before) * self.period
        in_use = self._used[-1] if self._used else -1
        self._used += [in_use] * (tick - before - 1) + [self._heard_tick]
        self._Judge(t, t - self._echo * self.period)
        change = passed / self._fade * (-1 if self._is_stale else 1)
        self._share = min(max(self._share + change, 0.0), 1.0)
        if self._share == 1:
            self._fed, self._safe = self._in_use, self._in_use * ~self._falls
        else:
            self._fed = self._safe + self._share * (self._in_use - self._safe)
        size = self.initial[self._spoken].size
        try:
            values = np.array(self._step(t, self._fed), float)
            if values.shape != (size,) or not np.isfinite(values).all():
                raise ArithmeticError(f"must send {size} finite numbers, not {values}")
        except Exception as error:
            self._End(f"{type(error).__name__}: {error}", "diverged")
            return
        late, ages = now - self.next_time, (tick - self._heard_tick, tick - self._echo)
        self._rows.append((tick, now, late, *ages))
        self._packets.append((self._fed, values))
        self._Speak(values, RUNNING)
        self.next_time = self._start + (tick + 1) * period_ns

    def _Judge(self, t: float, age: float) -> None:
        """Notes whether what is in use is too old."""
        was_stale, limit = self._is_stale, self._limit
        self._is_stale = age > limit or self._peer_has_ended
        if self._is_stale and not was_stale:
            self._outages.append([t, t])
            line = f"what is heard is {age:.3g} s old, more than {limit:g} s"
            self.Say(f"t = {t:.3f} s: {line}: forces fall to zero")
        elif was_stale:
            self._outages[-1][1] = t
            if not self._is_stale:
                self.Say(f"t = {t:.3f} s: it is heard again: forces come back")

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
        ticks, woken, _, ages, trips = np.array(self._rows).T
        fed, sent = map(np.array, zip(*self._packets, strict=True))
        signals = {f"{self._heard}_packet_received": fed}
        signals[f"{self._spoken}_packet_sent"] = sent
        is_simulated = self._step is self._half
        signals |= self._half.Signals() if is_simulated else {}
        signals["packet_age"] = ages[:, np.newaxis] * self.period
        signals["round_trip"] = trips[:, np.newaxis] * self.period
        config = self.scenario.simulator
        steps, evaluations = self._half.Counts()
        seconds = max(float(woken[-1] - woken[0]) * 1e-9, self.period)
        solver = SolverStatistics(
            engine="compiled" if is_simulated else "step",
            scheme=config.integration_scheme,
            accuracy=config.accuracy,
            steps=steps,
            derivative_evaluations=evaluations,
            wall_time_s=seconds,
            real_time_factor=float(ticks[-1]) * self.period / seconds,
        )
        return Recording(
            scenario=self.scenario,
            time=ticks * self.period,
            signals=signals,
            events=[],
            solver=solver,
            termination=self._termination,
            reason=self.reason or "",
        )

    def Delays(self) -> dict[str, Array]:
        """Returns how long each packet took until it was in use, s; NaN: it never was.

        Returns:
            By `forward` and `return`; entry k is of the packet of tick k.
        """
        heard_of = range(max(self._peer_used, default=-1) + 1)
        peer_used = [self._peer_used.get(tick, -1) for tick in heard_of]
        used = {self._heard: self._used, self._spoken: peer_used}
        num = self._tick + 1
        return {way: self.period * _Delays(x, num) for way, x in used.items()}

    def Report(self) -> dict[str, Any]:
        """Returns what was measured, times in s, as JSON has it."""
        ticks, woken, late, _, trips = np.array(self._rows).T
        periods = np.diff(woken, append=woken[-1] + round(self.period * 1e9)) * 1e-9
        known = [tick for tick in self._peer_used if tick >= 0]
        span = max(known, default=-1) + 1 - min(known, default=0)
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
            "unused_packets": {
                way: int(np.isnan(x).sum()) for way, x in self.Delays().items()
            },
            "unknown_periods": span - len(known),
            "refused_packets": dict(self._session.refused),
            "outages": self._outages,
        }


def _Delays(used: Sequence[int], num: int) -> Array:
    """Returns after how many ticks each of `num` packets came into use, NaN: never."""
    delays = np.full(num, np.nan)
    for tick in range(len(used) - 1, -1, -1):
        if 0 <= used[tick] < num:
            # It is less than 0 where the clocks have drifted apart.
            delays[used[tick]] = max(tick - used[tick], 0)
    return delays


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
