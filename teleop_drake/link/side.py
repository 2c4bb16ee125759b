"""One side of the loop over a real network: hears, computes, speaks once a period."""

import functools
import gc
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder

from teleop_drake.arrays import Array
from teleop_drake.laws.task_space import displacement
from teleop_drake.link.packets import NUM_USED, OpenSocket, ReadKey, Session
from teleop_drake.numerics.step_polynomials import straight_steps
from teleop_drake.recording import Recording
from teleop_drake.robots.facts import FactsOfRobot
from teleop_drake.scenario import AsTeleoperation, CheckSteps, Scenario, ScenarioLike
from teleop_drake.scenario.tree import ToTree
from teleop_drake.simulation.compiled_run import OutcomeOf, StartFed
from teleop_drake.simulation.simulate import MakeRecording
from teleop_drake.teleoperator import AddTeleoperator
from teleop_drake.validation import CheckNumber, Refuse

# Round trips that are measured before the start, farewells, and the most datagrams that
# are read in a period: a flood takes no longer.
_NUM_EXCHANGES, _NUM_FAREWELLS, _MAX_DATAGRAMS = 10, 3, 256
_OVER = "the other side has ended"

_MEASURED = "packet_age", "round_trip", "period", "lateness", "trust"
_STATISTICS = "mean", "deviation", "least", "median", "most"

Say = functools.partial(print, "teleop-drake:", file=sys.stderr, flush=True)
"""Tells the user a line."""

WAYS = {"operator": ("return", "forward"), "robot": ("forward", "return")}
"""The directions in which a side hears and speaks."""

# Parts of a packet that are held where nothing is heard: positions and energies.
_HELD = ("p", "x", "E")

# How fast the tool is held in its place, rad/s at most.
_RATE = 20.0


class Half:
    """A side that is simulated, and fed with what is heard as far as that is trusted.

    As trust falls, so do forces, velocities, accelerations and waves, and positions are
    held; as it comes back, they all go to what is heard. Meanwhile a spring and a
    damper hold the tool of the robot in its place. With its inertia at the start they
    are critically damped.

    Args:
        scenario: Of the whole loop.
        side: One of WAYS.
        period: Between steps, s.
        fade: In which time trust falls from 1 to 0, and comes back, s.
        more: `step`, see Side, and systems of one's own.

    Attributes:
        heard, spoken: The directions of the side.
        fed: The packet that is in use.
        sent: Those that were sent; the first ones are the architecture's, as `fed` is.
        trust: 0 to 1.

    Raises:
        CannotCompile: If a system cannot be compiled; it is named.
    """

    def __init__(
        self, scenario: Scenario, side: str, period: float, fade: float, more: Any
    ):
        self.scenario, self.side, self.period, self.fade = scenario, side, period, fade
        self.heard, self.spoken = heard, spoken = WAYS[side]
        self._step, own = more.get("step"), {x: more[x] for x in more if x != "step"}
        builder = DiagramBuilder()
        architecture = AddTeleoperator(builder, scenario, side=side, **own)
        self.fed = np.array(getattr(architecture, f"initial_{heard}_packet"), float)
        self.sent = [np.array(getattr(architecture, f"initial_{spoken}_packet"), float)]
        self.trust, self._num, self._faded = 1.0, int(np.ceil(fade / period)), 0
        parts = getattr(scenario.controller.Chosen(), f"{heard}_parts")
        names = np.repeat(parts, scenario.num_axes)[: self.fed.size]
        if len(names) < self.fed.size:
            allowed = f"one that has {heard}_parts, so that its forces can fall"
            Refuse("controller.kind", scenario.controller.kind, allowed)
        self._falls = np.array([not name.startswith(_HELD) for name in names])
        inputs, find = {"packet": self.fed}, builder.GetSubsystemByName
        builder.ExportInput(find(f"{heard}_channel").get_input_port(), "packet")
        if side == "robot":
            robot = find("robot")
            law = find("controller").GetOutputPort("control_force")
            if (inertia := FactsOfRobot(robot).inertia) is None:
                Refuse("robot", robot.get_name(), "one that tells its inertia")
            rate = min(_RATE, 0.2 / period)
            self._stiffness, self._lead = rate**2 * inertia, 2 / rate
            inputs["force"] = np.zeros(len(inertia))
            target = robot.GetInputPort("control_force")
            hold = builder.AddNamedSystem("hold", Adder(2, len(inertia)))
            builder.Disconnect(law, target)
            builder.Connect(law, hold.get_input_port(0))
            builder.Connect(hold.get_output_port(), target)
            builder.ExportInput(hold.get_input_port(1), "force")
        diagram, config = builder.Build(), scenario.simulator
        self._model, self._rows = (scenario, diagram, config), list[tuple[Array, ...]]()
        started: Any = None, {f"{spoken}_packet_sent": slice(None)}, {}
        if self._step is None:
            started = StartFed(diagram, config, scenario.duration, **inputs)
        self._run, self._places, self._fed = started

    def Step(self, t: float, heard: Array, turn: int) -> None:
        """Goes on to t in s; sends what there is then, and is fed from then on.

        Args:
            heard: The packet that is in use.
            turn: Whether trust falls (1) or comes back (-1); 0: nothing is fed.
        """
        before = self.fed
        self._faded = min(max(self._faded + turn, 0), self._num)
        self.trust = 1 - self._faded / self._num
        if turn:
            left = self._faded if turn < 0 else self._num - self._faded
            target = heard if turn < 0 else np.where(self._falls, 0.0, before)
            self.fed = before + (target - before) / (left + 1) if left else target
        row = np.array(self._run.Sample(t) if self._run else self._step(t, self.fed))
        sent = row[self._places[f"{self.spoken}_packet_sent"]]
        if sent.shape != self.sent[0].shape or not np.isfinite(sent).all():
            wanted = f"must send {self.sent[0].size} finite numbers"
            raise ArithmeticError(f"{wanted}, not {sent}")
        self.sent.append(sent)
        self._rows.append((before, row))
        if turn and self._run:
            self._run.Feed(self._fed[f"{self.heard}_channel"], self.fed)
        if turn and "hold" in self._fed:
            p, v = (row[self._places[f"tool_{x}"]] for x in ("position", "velocity"))
            if self.trust == 1 or len(self._rows) == 1:
                self._place = p
            apart = displacement(self._place, p) if self.trust < 1 else 0 * p
            force = (1 - self.trust) * self._stiffness @ (apart - self._lead * v)
            self._run.Feed(self._fed["hold"], force)

    def Signals(self, num: int) -> dict[str, Array]:
        """Returns the signals (N, k) of the first steps, by their names."""
        fed, rows = map(np.array, zip(*self._rows[:num], strict=True))
        signals = {name: rows[:, place] for name, place in self._places.items()}
        return {f"{self.heard}_packet_received": fed} | signals


class Side(Half):
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
        period: Time between packets, s.
        limit: Most age of what is in use, s: since that was sent which the other side
            had in use then. If it is more, trust falls within `fade` s of periods that
            were not missed; see Half.
        patience: After which silence it ends, s.
        more: Systems of one's own, as MakeTeleoperator() takes them; no channels. Or
            `step`, in the place of a simulation: takes the time in s and
            the packet that is in use, and returns what to send, once a period. When it
            is no longer called, what it drives has to let go by itself.

    Attributes:
        next_time: When Tick() is due, by the clock.
        tick: The last one; -1 before the start.
        reason: Why it has ended, empty: it is complete; None while it goes on.
        log: Of each tick that was not missed, after a row before the start: the tick;
            1 if what was in use was too old, else -1; and what was measured.
        used: Of each way, the tick of the packet that was in use at each tick where it
            is heard; -1: none, or it was missed; -2: not known.
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
        period: float = 0.001,
        limit: float = 0.5,
        fade: float = 0.1,
        patience: float = 5.0,
        say: Callable[[str], None] = Say,
        **more: Any,
    ):
        scenario = AsTeleoperation(scenario)
        CheckSteps(scenario)
        times = {"period": period, "limit": limit, "fade": fade, "patience": patience}
        for name, seconds in times.items():
            CheckNumber(name, seconds, "s", minimum=1e-4)
        for name in {"architecture", "forward_channel", "return_channel"} & more.keys():
            Refuse(name, more[name], "left out: the network is the scenario's channel")
        Half.__init__(self, scenario, side, period, fade, more)
        self.limit, self._patience = limit, patience
        self._socket, self._clock, self.Say = end, clock, say
        agreement = _Agreement(scenario, period, limit, fade)
        self._session = Session(key, side == "robot", agreement, self.fed.size, address)
        self.next_time = self._began = self._heard_at = clock()
        self.reason: str | None = None
        self._termination, self._start, self.tick = "completed", 0, -1
        self._newest: Any = {"tick": -1, "used": [-1], "values": self.fed}
        self._peer_has_ended = self._is_told = False
        self._ns, self._last = round(period * 1e9), round(scenario.duration / period)
        self.log: list[Any] = [(-1, -1, 0, 0, 0, 0, 1.0)]
        num = NUM_USED + self._last + 1
        self._padded = {self.heard: np.full(num, -1), self.spoken: np.full(num, -2)}
        self.used = {way: used[NUM_USED:] for way, used in self._padded.items()}

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
        if len(self.log) == 1:
            raise ConnectionError(f"no connection: {self.reason}")
        return self

    def Tick(self) -> None:
        """Does what is due: hears, computes, speaks."""
        self._Hear()
        now = self._clock()
        if self._start or self._Meets(now):
            self._GoOn(now)
        self._Speak()
        self.next_time = (self._start or now + self._ns) + (self.tick + 1) * self._ns
        # The robot's side waits for as long as it takes.
        is_waiting = self.side == "robot" and not self._start
        if self._peer_has_ended and (self.trust == 0 or not self._start):
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
                tick = packet["tick"]
                # One that is complete is no loss.
                self._peer_has_ended |= bool(packet["ended"]) and tick < self._last
                if tick > self._newest["tick"]:
                    self._newest = packet
                    self._padded[self.spoken][tick + 1 :][:NUM_USED] = packet["used"]
        if not self._is_told and (refused["version"] or refused["scenario"]):
            self.Say("not heard: the other side's version, scenario or options differ")
            self._is_told = True

    def _Meets(self, now: int) -> bool:
        """Returns whether both sides hear each other, and sets tick 0."""
        if self.side == "robot" and self._newest["tick"] >= 0:
            self._start = max(round(self._newest["start"] - self._session.offset), 1)
        elif self.side == "operator" and self._session.exchanges >= _NUM_EXCHANGES:
            self._start = now
        if self._start:
            self.next_time, self._began = now, now - self._ns
            self.Say(f"connected, round trip {self._session.round_trip * 1e-6:.3g} ms")
        return self._start > 0

    def _GoOn(self, now: int) -> None:
        """Goes on to the tick that is due; those that were missed send nothing."""
        due = min((now - self._start) // self._ns, self._last)
        tick, newest = max(due, self.tick + 1), self._newest
        t, age = tick * self.period, (tick - max(newest["used"][-1], 0)) * self.period
        turn = 1 if age > self.limit or self._peer_has_ended else -1
        if turn != self.log[-1][1]:
            why = _OVER if self._peer_has_ended else f"what is heard is {age:.3g} s old"
            so = "fall to zero" if turn > 0 else "come back"
            self.Say(f"t = {t:.3f} s, {why}: forces {so}")
        try:
            self.Step(t, newest["values"], turn)
        except Exception as error:
            self._End(f"{type(error).__name__}: {error}", "diverged")
            return
        ages = (tick - newest["tick"]) * self.period, age
        times = (now - self._began) * 1e-9, (now - self.next_time) * 1e-9
        self.used[self.heard][tick] = newest["tick"]
        # The log is last: whatever interrupts, it has nothing that is half done.
        self.tick, self._began = tick, now
        self.log.append((tick, turn, *ages, *times, self.trust))

    def _Speak(self) -> None:
        """Sends a packet, if it is known where to; one that is not taken is lost."""
        if address := self._session.address:
            used = self._padded[self.heard][self.tick + 1 :][:NUM_USED]
            state = self.sent[-1], self._start, self.tick, used
            data = self._session.Seal(self._clock(), self.reason is not None, *state)
            with suppress(OSError):
                self._socket.sendto(data, address)

    def Recording(self) -> Recording:
        """Returns the signals each period.

        They include the age in s of what was in use (`packet_age`), of the echo in it
        (`round_trip`), how long after the one before a period began (`period`), how
        late (`lateness`), and how far what was in use was trusted, 0 to 1 (`trust`).
        """
        ticks, _, *measured = np.transpose(self.log[1:])[:, :, np.newaxis]
        time = ticks[:, 0] * self.period
        signals = dict(zip(_MEASURED, measured, strict=True)) | self.Signals(len(time))
        series, wall_time = (time, signals, straight_steps(time)), float(np.ptp(time))
        ending = max(wall_time, 1e-9), self._termination, self.reason or ""
        return MakeRecording(*self._model, OutcomeOf(self._run, series, *ending), [])

    def Used(self) -> dict[str, Any]:
        """Returns of each way which packet was in use at each tick where it is heard.

        In between of what is known, packets are taken in steady steps.
        """
        ticks, steady = np.arange(self.tick + 1), {}
        for way, used in self.used.items():
            known = np.flatnonzero(used[: ticks.size] > -2)
            steps = np.maximum.accumulate(np.append(-1, used[known]))
            between = np.interp(ticks, np.append(-1, known), steps)
            steady[way] = np.floor(between).astype(int).clip(max=self.tick)
        return steady

    def Delays(self) -> dict[str, Array]:
        """Returns how long each packet took until it was in use, s; NaN: it never was.

        Returns:
            By `forward` and `return`; entry k is of the packet of tick k. It is less
            than 0 if clocks have drifted so far that it was in use before its tick.
        """
        delays = {}
        for way, used in self.Used().items():
            taken, ticks = np.unique(np.append(-1, used), return_index=True)
            delays[way] = np.full(self.tick + 1, np.nan)
            delays[way][taken[1:]] = self.period * (ticks - 1 - taken)[1:]
        return delays

    def Report(self) -> dict[str, Any]:
        """Returns what was measured, times in s, as JSON has it."""
        run, delays = self.Recording(), self.Delays()
        changes = np.flatnonzero(np.diff([row[1] for row in self.log], append=-1))
        known = np.flatnonzero(self.used[self.spoken] > -2)
        outages = np.append(run.time, run.time[-1])[changes].reshape(-1, 2)
        report = {
            "scenario": self.scenario.name,
            "controller": self.scenario.controller.kind,
            "side": self.side,
            "termination": run.termination,
            "reason": run.reason,
            "duration": round(float(run.time[-1]), 9),
            "shortest_round_trip": round(self._session.round_trip) / 1e9,
            "missed_periods": round(np.ptp(run.time) / self.period) + 1 - len(run.time),
            "unused_packets": {x: int(np.isnan(y).sum()) for x, y in delays.items()},
            "early_packets": {x: int((y < 0).sum()) for x, y in delays.items()},
            "unknown_periods": int(np.sum(np.diff(known) - 1)),
            "refused_packets": dict(self._session.refused),
            "outages": outages.round(6).tolist(),
        }
        for name in _MEASURED[:4]:
            x = run[name]
            numbers = np.round((x.mean(), x.std(), *np.percentile(x, (0, 50, 100))), 9)
            report[name] = dict(zip(_STATISTICS, numbers.tolist(), strict=True))
        return report


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
    end, address = OpenSocket(connect, listens=False)
    return Side(scenario, "operator", ReadKey(key), end, address, **more).Run()


def ServeRobot(scenario: ScenarioLike, *, listen: str, key: str, **more: Any) -> Side:
    """Runs the robot's side at HOST:PORT; waits until OperateRemotely() calls."""
    end, _ = OpenSocket(listen, listens=True)
    side = Side(scenario, "robot", ReadKey(key), end, **more)
    side.Say("listening at {}:{}".format(*end.getsockname()[:2]))
    return side.Run()
