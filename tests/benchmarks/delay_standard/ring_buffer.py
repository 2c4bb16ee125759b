"""SciPy by hand: a ring buffer of samples, read once a step and held."""

from collections import deque

import numpy as np
from benchmarks.delay_standard.packet_tasks import jittered_packets, stale_packets
from benchmarks.delay_standard.simulator import Input, Simulator
from scipy.signal import cont2discrete

STEP = 0.01


class RingBuffer(Simulator):
    """The loop that people write: shift the buffer, step, hold what came out.

    Between two samples the plant is solved exactly (cont2discrete).
    """

    name = "SciPy and a ring buffer"
    pd_step = 1e-3

    def echo(self, signal: Input, path, times):
        step = STEP if min(path) >= STEP else 0.002
        buffers = [self._buffer(T, step, np.zeros(signal.size)) for T in path]
        rows = []
        for k in range(round(times[-1] / step) + 1):
            value = signal(k * step)
            for buffer in buffers:
                buffer.append(value)
                value = buffer[0]
            rows.append(value)
        return np.array(rows)[np.round(times / step).astype(int)]

    def varying_echo(self, signal: Input, T, times):
        """The delay is a whole number of steps, the nearest one at each instant."""
        values = [signal(k * STEP) for k in range(round(times[-1] / STEP) + 1)]
        rows = []
        for k in np.round(times / STEP).astype(int):
            late = k - round(T(k * STEP) / STEP)
            rows.append(values[late] if late >= 0 else 0 * values[0])
        return np.array(rows)

    def switched_echo(self, signal: Input, delays, times):
        return np.column_stack([self.echo(signal, [T], times)[:, 0] for T in delays])

    def packets(self, times):
        return np.array([self._newest(jittered_packets(), t) for t in times])

    def stale_command(self, times):
        """The clock ticks each millisecond; the watchdog counts its ticks."""
        mail = {round(1000 * packet.arrival): packet for packet in stale_packets()}
        command = 0.0
        travel = 0.0
        expiry = 0
        rows = []
        for tick in range(round(1000 * times[-1]) + 1):
            if tick in mail:
                command = float(mail[tick].value)
                expiry = tick + 100
            if tick >= expiry:
                command = 0.0
            rows.append([command, travel])
            travel += 0.001 * command
        return np.array(rows)[np.round(1000 * times).astype(int)]

    @staticmethod
    def _newest(packets, t):
        """Returns the value of the newest packet that has arrived, 0 before."""
        arrived = [packet for packet in packets if packet.arrival <= t + 1e-9]
        return float(max((packet.value for packet in arrived), default=0))

    @staticmethod
    def _buffer(T, step, initial):
        """Returns a buffer whose first element is T old once the newest is in it."""
        length = round(T / step) + 1
        return deque([initial] * length, maxlen=length)

    def _loop(self, A, B, start, control, sensor, actuator, times, history):
        """Steps x' = A x + B u, u = control(x late), late itself, 0 before."""
        step = self.pd_step if times[-1] > 30 else 1e-4
        Ad, Bd, *_ = cont2discrete((A, B, np.eye(len(A)), 0 * B), step)
        x = np.array(start)
        measured = self._buffer(sensor, step, np.array(history))
        sent = self._buffer(actuator, step, 0.0)
        rows = []
        for _ in range(round(times[-1] / step) + 1):
            rows.append(x[0])
            measured.append(x)
            sent.append(control(measured[0]))
            x = Ad @ x + Bd[:, 0] * sent[0]
        return np.array(rows)[np.round(times / step).astype(int)]

    def scalar_loop(self, k, T, times):
        A = np.zeros((1, 1))
        B = np.ones((1, 1))
        return self._loop(A, B, [1.0], lambda x: -k * x[0], T, 0.0, times, [1.0])

    def pd(self, sensor, actuator, times):
        A = np.array([[0.0, 1.0], [0.0, 0.0]])
        B = np.array([[0.0], [1.0]])
        start = [0.0, 0.0]

        def control(x):
            return 4 * (1 - x[0]) - 2 * x[1]

        return self._loop(A, B, start, control, sensor, actuator, times, start)
