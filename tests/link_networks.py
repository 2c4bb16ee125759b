"""Two sides in one process, with simulated clocks and a network with a seed."""

import heapq
from types import SimpleNamespace

from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss
from teleop_drake.loops.delays.variable import DelayProfile
from teleop_drake.study.link.side import Side

KEY = bytes(range(32))


def Fates(seed, *, delay=0.02, std=0.004, loss=0.05, duration=100.0):
    """Returns a function of k: the delays in s of the copies of datagram k.

    A datagram without copies is lost; some have two copies.
    """
    network = PacketNetwork(
        profile=DelayProfile(delay=delay, duration=duration),
        sample_period=0.001,
        jitter=Jitter(kind="gamma", std=std, minimum=delay / 2) if std else None,
        loss=Loss(kind="burst", probability=loss, burst_length=4) if loss else None,
        seed=seed,
    )

    def Copies(k):
        arrival = network.Arrival(k)
        if arrival == float("inf"):
            return []
        delay = arrival - k * 0.001
        return [delay, delay + 0.003] if seed and k % 7 == 0 else [delay]

    return Copies


class Network:
    """Carries datagrams between two sides, in simulated time.

    Args:
        fates: A function as Fates() returns it, for each direction.
        offsets: The times of the sides' clocks at time 0, ns.
    """

    def __init__(self, *fates, offsets=(1, 1)):
        self.now = 0
        self._fates = fates
        self._offsets = list(offsets)
        self._queues = ([], [])
        self._counts = [0, 0]
        self.lines = [], []

    def MakeSides(self, scenario, options=({}, {}), **both):
        return [
            Side(
                scenario,
                ("operator", "robot")[i],
                KEY,
                SimpleNamespace(
                    sendto=lambda data, address, i=i: self.Send(i, data),
                    recvfrom=lambda size, i=i: self.Receive(i),
                    close=lambda: None,
                ),
                *["there"][i:],
                clock=lambda i=i: self.now + self._offsets[i],
                say=self.lines[i].append,
                **options[i] | both,
            )
            for i in range(2)
        ]

    def Run(self, sides, *, until=float("inf"), phase=0.00037, stopped=()):
        """Ticks the side that is due next, until a time in s or until all have ended.

        Args:
            until: The last time, s.
            phase: The delay of the robot's first tick after the operator's, s.
            stopped: Sides that do not tick, as if their processes were suspended.
        """
        if self.now == 0:
            sides[1].next_time += round(phase * 1e9)
        while running := [x for x in (0, 1) if sides[x].reason is None]:
            awake = [x for x in running if x not in stopped]
            due = [(sides[x].next_time - self._offsets[x], x) for x in awake]
            time, i = min(due, default=(float("inf"), 0))
            if max(time, self.now) >= until * 1e9:
                self.now = round(until * 1e9)
                return
            assert due, "nothing would ever happen"
            self.now = max(self.now, time)
            sides[i].Tick()

    def Skip(self, sides, i, seconds):
        """Sets the clock of side i ahead."""
        self._offsets[i] += round(seconds * 1e9)

    def Send(self, i, data):
        for copy, delay in enumerate(self._fates[i](self._counts[i])):
            at = self.now + round(delay * 1e9)
            heapq.heappush(self._queues[1 - i], (at, self._counts[i], copy, data))
        self._counts[i] += 1

    def Receive(self, i):
        queue = self._queues[i]
        if not queue or queue[0][0] > self.now:
            raise BlockingIOError
        return heapq.heappop(queue)[3], "there"
