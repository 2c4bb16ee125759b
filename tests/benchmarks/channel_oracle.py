"""The independent solution over channels that are no constant delay."""

import bisect
import functools
from math import inf, isinf

import numpy as np
from benchmarks.accuracy import ThesisTask
from independent_solver import Result, _accept, _kind, _monitors
from scipy.integrate import DOP853
from scipy.optimize import brentq

from teleop_drake.channels import ChannelConfig
from teleop_drake.channels.packet_network import PacketNetwork
from teleop_drake.scenario import Scenario

_TINY = 1e-12
_HOPS = 4  # Through how many channels a jump's echoes are followed.


def _Solve(task, controller, delay, duration, make):
    problem = ThesisTask(task, controller, delay)
    result = make(problem)
    rtol = 1e-10
    n = result.n
    speed = np.linalg.norm(problem.velocity)
    atol = np.full(len(result.start_state), 0.1 * rtol * speed)
    atol[2 * n : 4 * n] /= problem.denominator[1]
    if result.law is not None:
        _, j, k = 4 * n + result.law.cuts
        atol[j:k] = rtol
    t, y = 0.0, result.start_state
    layer = problem.layer_at(result.p_start[0])
    while t < duration - _TINY:
        result.Arrive(t, y, layer)
        bound = min(result.NextBreak(t), duration)
        f = result.Derivative(layer, (t + bound) / 2)
        solver = DOP853(
            f, t, y, bound, rtol=rtol, atol=atol, max_step=result.longest_step
        )
        monitors = _monitors(problem, layer, 5 * speed)
        while solver.status == "running":
            message = solver.step()
            assert solver.status != "failed", message
            piece, hit = _accept(solver, layer, monitors, problem.robot)
            result.append(piece)
            t, y = piece.end, piece.state(piece.end) if hit else solver.y
            if hit == "diverged":
                return result
            if hit:
                before, layer = layer, layer + (1 if hit == "up" else -1)
                result.Cross(t, _kind(problem, before, layer))
                break
    return result


class _Channels(Result):
    """What both kinds have in common; `jumps` are where F_e or F_c jump."""

    def __init__(self, task):
        super().__init__(task)
        self.jumps = []

    def Arrive(self, t, y, layer):
        pass

    def Cross(self, t, kind):
        self.jumps.append(t)

    def at(self, t, side="right"):
        """Position, velocity, F_e and F_c, as Result.at() names them."""
        piece = self.piece_at(t, side)
        y = piece.state(t)
        p, v, F_e = self.motion(piece.layer, y)
        F_c = y[4 * self.n : 5 * self.n]
        if self.law is None:
            F_c = self.ReceivedForce(t, y, piece)
        return {"p_WT": p, "v_WT": v, "F_e": F_e, "F_c": F_c}


class _Variable(_Channels):
    """Both delays are T(t) = delay + amplitude sin(frequency t + phase)."""

    def __init__(self, task, amplitude, frequency, phase):
        super().__init__(task)
        self.T = lambda t: (
            task.forward_delay + amplitude * np.sin(frequency * t + phase)
        )
        self.longest_step = task.forward_delay - amplitude
        self._longest = task.forward_delay + amplitude
        self._breaks: list[float] = []
        self._Break(0.0)

    def _ArrivalTime(self, sent):
        return brentq(
            lambda t: t - self.T(t) - sent, sent, sent + self._longest, xtol=1e-14
        )

    def _Break(self, time):
        for _ in range(_HOPS + 1):
            bisect.insort(self._breaks, time)
            time = self._ArrivalTime(time)

    def NextBreak(self, t):
        return next((b for b in self._breaks if b > t + _TINY), inf)

    def Cross(self, t, kind):
        self._Break(t)
        self.jumps.append(t)
        if kind == "contact" and self.perceives and isinf(self.perceived):
            self.perceived = self._ArrivalTime(t)
            self._Break(self.perceived)
            self.jumps += [self.perceived, self._ArrivalTime(self.perceived)]

    def received_force(self, t, y, command_force):
        if command_force is not None:
            return command_force
        return self.device_force(self._Past(t))

    def felt(self, t, p, v):
        if t - self.T(t) < 0:
            return self.p_start, np.zeros(self.n)
        q, qdot = self._Past(t)[: 2 * self.n].reshape(2, self.n)
        return self.task.robot.tool(q, qdot)

    def _Past(self, t):
        sent = t - self.T(t)
        return self.piece_at(sent, "left").state(sent)

    def Derivative(self, layer, inside):
        v_d, _ = self.command(inside)
        v_dd, force = self.command(inside - self.T(inside))
        return self.derivative(layer, v_d, v_dd, force)

    def ReceivedForce(self, t, y, piece):
        inside = (piece.start + piece.end) / 2
        return self.received_force(t, y, self.command(inside - self.T(inside))[1])


class _Packets(_Channels):
    """Both directions hold the newest packet that has arrived.

    A step ends at each sending and each arrival. When packets of a network arrive is
    drawn from a seed: those times are the package's, as data.
    """

    longest_step = inf

    def __init__(self, task, period, forward_arrivals, return_arrivals):
        super().__init__(task)
        n = self.n
        self._period = period
        self._arrivals = (forward_arrivals, return_arrivals)
        every = [*forward_arrivals, *return_arrivals]
        self._breaks = sorted(
            {time for time in every if time < inf}
            | {k * period for k in range(len(forward_arrivals))}
        )
        self._sent: tuple[list, list] = ([], [])
        # (stamp, value) of what is shown.
        self._shown = [
            (-1, np.zeros(2 * n)),
            (-1, np.concatenate([self.p_start, np.zeros(n)])),
        ]
        self._force_of: list[np.ndarray] = []

    def NextBreak(self, t):
        return self._breaks[bisect.bisect_right(self._breaks, t + _TINY)]

    def Arrive(self, t, y, layer):
        k = len(self._sent[0])
        if t >= k * self._period - _TINY:
            v_d, force = self.command(t)
            if force is None:
                force = self.device_force(y)
            p, v, _ = self.motion(layer, y)
            self._sent[0].append(np.concatenate([force, v_d]))
            self._sent[1].append(np.concatenate([p, v]))
        for way in (0, 1):
            arrived = [
                k
                for k in range(max(self._shown[way][0] + 1, 0), len(self._sent[way]))
                if self._arrivals[way][k] <= t + _TINY
            ]
            if arrived:
                self._shown[way] = arrived[-1], self._sent[way][arrived[-1]]
        surface = self.task.contact_index()
        if not (self.perceives and isinf(self.perceived)):
            return
        if self._shown[1][1][0] >= self.task.layers[surface].start:
            self.perceived = t

    def append(self, piece):
        super().append(piece)
        self._force_of.append(self._shown[0][1][: self.n])

    def received_force(self, t, y, command_force):
        return self._shown[0][1][: self.n]

    def felt(self, t, p, v):
        return self._shown[1][1][: self.n], self._shown[1][1][self.n :]

    def Derivative(self, layer, inside):
        v_d, _ = self.command(inside)
        return self.derivative(layer, v_d, self._shown[0][1][self.n :], None)

    def ReceivedForce(self, t, y, piece):
        i = bisect.bisect_left([other.end for other in self.pieces], piece.end)
        return self._force_of[i]


def ChannelOracle(scenario: Scenario) -> Result:
    """Returns the independent solution of a thesis's task over its channels.

    Both channels have the same configuration, of kind variable, sampled or network
    (receiver newest).
    """
    channel, duration = scenario.forward_channel, scenario.duration
    arguments = (scenario.name, scenario.controller.kind, channel.delay, duration)
    if channel.kind == "variable":
        wave = channel.sinusoid
        return _Solve(
            *arguments,
            functools.partial(
                _Variable,
                amplitude=wave.amplitude,
                frequency=wave.frequency,
                phase=wave.phase,
            ),
        )
    forward, backward = (
        _Arrivals(channel, duration, stream)
        for stream in ("forward_channel", "return_channel")
    )
    return _Solve(
        *arguments,
        functools.partial(
            _Packets,
            period=channel.sample_period,
            forward_arrivals=forward,
            return_arrivals=backward,
        ),
    )


def _Arrivals(channel: ChannelConfig, duration: float, stream: str) -> tuple:
    period = channel.sample_period
    assert period is not None
    count = round(duration / period) + 1
    if channel.kind == "sampled":
        return tuple(k * period + channel.delay for k in range(count))
    network = PacketNetwork(
        profile=channel.Profile(duration),
        sample_period=period,
        jitter=channel.jitter,
        loss=channel.loss,
        seed=channel.seed,
        stream=stream,
    )
    return tuple(network.Arrivals(count).tolist())
