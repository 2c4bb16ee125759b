"""Diagrams at random: kernels and Drake's primitives in loops, nested, with events.

Signals have three numbers each. What holds or delays comes first, so that there is
something to take; then what feeds through, one after another; at last the inputs of the
first ones are connected, to anything. So there are loops, none of them algebraic.

Signals stay of the size of 1: states relax, and what goes into a loop is limited.
A delay takes no signal that is rough. Drake's discrete updates come after the events in
which a delay records jumps, and nothing ends a step where a Saturation begins.
"""

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import BasicVector, DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    AffineSystem,
    ConstantVectorSource,
    Demultiplexer,
    Gain,
    LinearSystem,
    MatrixGain,
    Multiplexer,
    PassThrough,
    Saturation,
    Sine,
    ZeroOrderHold,
)

from teleop_drake.channels.network import NetworkDelay
from teleop_drake.channels.packet_network import Jitter, Loss, PacketNetwork, Receiver
from teleop_drake.channels.sampled import SampledDelay
from teleop_drake.channels.transport import TransportDelay
from teleop_drake.channels.variable import DelayProfile, Sinusoid, VariableDelay
from teleop_drake.kernel import Kernel, KernelBlock, Transition, times

N = 3
END = 1.0


class Signal(NamedTuple):
    """An output port, and whether its signal is rough."""

    port: object
    is_rough: bool


# Laws of kernels.


def mixed(W, x, u):
    return np.tanh(W @ u) - x


def bent(W, x, u):
    result = -0.5 * x
    for i in range(N):
        if u[i] > x[i]:
            result[i] += (u[i] - x[i]) ** 2 / (1 + abs(u[i]))
    return result + 0.3 * np.sin(W @ x)


def bounded(u):
    return 2 * np.tanh(u / 2)


def product(W, x, u):
    return np.tanh(u) * (W @ x)


def chirp(t, u):
    return np.cos((4 + t) * t + u)


def pulled(k, x, mode, u):
    return mode[0] * k - x + 0.2 * np.tanh(u)


def above(x, mode, u):
    return np.array([mode[0] * x[0] - 0.3])


def turned(mode):
    return np.array([-mode[0], mode[1] + 1, *mode[2:]])


def taken(mode, u):
    return np.array([*mode[:2], *np.tanh(u)])


def shown(x, mode):
    return x + 0.1 * mode[2:]


class Own(KernelBlock):
    """A block with a kernel; its mode is a sign, a count, and a sample."""

    def __init__(self, inputs, *, has_mode=False, **kernel):
        KernelBlock.__init__(self)
        self._kernel = kernel
        for name in inputs:
            self.DeclareVectorInputPort(name, N)
        if kernel.get("rate"):
            self.DeclareContinuousState(BasicVector([0.5, -0.2, 0.1]))
        if has_mode:
            self.DeclareDiscreteState([1.0, 0.0, *np.zeros(N)])
        self.DeclareOutputs(y=N)

    def Kernel(self):
        return Kernel(**self._kernel)


class Random:
    """Makes one diagram.

    Args:
        seed: Of what is chosen.
    """

    def __init__(self, seed):
        self._rng = np.random.default_rng(seed)
        self._count = 0

    def Make(self, num_blocks=6, depth=2, outer=()):
        """Returns a diagram, the signals outside for its inputs, and its outputs.

        Args:
            outer: What there is outside. None of it is connected here.
        """
        builder, rng = DiagramBuilder(), self._rng
        signals, fed, waiting = [], [], []
        for signal in outer:
            block = self._Add(builder, PassThrough(N))
            builder.ExportInput(block.get_input_port(), f"u{len(fed)}")
            fed.append(signal)
            if rng.random() < 0.5:  # One input of the diagram, two in it.
                block = self._Add(builder, Gain(0.8, N))
                builder.ConnectInput(f"u{len(fed) - 1}", block.get_input_port())
            signals.append(Signal(block.get_output_port(), signal.is_rough))
        waves = Sine(rng.normal(size=N), [3, 5, 7], rng.normal(size=N), True)
        source = self._Add(builder, waves)
        signals.append(Signal(source.get_output_port(0), False))
        for _ in range(num_blocks // 2):
            system, is_rough, is_smooth_only = self._Holding()
            block = self._Add(builder, system)
            signals.append(Signal(block.get_output_port(0), is_rough))
            waiting.append((block, is_smooth_only))
        for k in range(num_blocks - num_blocks // 2):
            if depth and k % 2:
                taken = [self._Pick(signals) for _ in range(rng.integers(1, 3))]
                part = Random(int(rng.integers(2**31)))
                inner, feeds, outputs = part.Make(num_blocks - 2, depth - 1, taken)
                inner.set_name(f"inner_{k}")
                builder.AddSystem(inner)
                for i, signal in enumerate(feeds):
                    builder.Connect(signal.port, inner.get_input_port(i))
                signals += [
                    Signal(inner.get_output_port(i), output.is_rough)
                    for i, output in enumerate(outputs)
                ]
            else:
                signals.append(self._FeedThrough(builder, signals))
        for block, is_smooth_only in waiting:
            given = [x for x in signals if not (is_smooth_only and x.is_rough)]
            for i in range(block.num_input_ports()):
                limit = self._Add(builder, Own(("u",), outputs={"y": (bounded, "u")}))
                builder.Connect(self._Pick(given).port, limit.get_input_port())
                builder.Connect(limit.get_output_port(), block.get_input_port(i))
        outputs = signals[-3:] if outer else signals
        for i, signal in enumerate(outputs):
            builder.ExportOutput(signal.port, f"y{i}")
        return builder.Build(), fed, outputs

    def _Pick(self, items):
        return items[self._rng.integers(len(items))]

    def _Add(self, builder, system):
        self._count += 1
        return builder.AddNamedSystem(f"{type(system).__name__}_{self._count}", system)

    def _Matrix(self):
        return 0.5 * self._rng.normal(size=(N, N))

    def _Holding(self):
        """Returns what nothing feeds through, and what `is_rough` says of it."""
        rng, W = self._rng, self._Matrix()
        delay = float(self._Pick([0.1, 0.2, 0.17, rng.uniform(0.05, 0.3)]))
        period = float(self._Pick([0.1, 0.05, 0.07, rng.uniform(0.04, 0.2)]))
        period = min(period, delay)  # As the channels ask for.
        I = np.eye(N)
        ramp = Own((), outputs={"y": (chirp, "time", "z")}, parameters={"z": W[0]})
        relay = {
            "rate": (pulled, "k", "state", "mode", "u"),
            "outputs": {"y": (shown, "state", "mode")},
            "parameters": {"k": rng.uniform(0.8, 1.5, N)},
            "transitions": {
                "turns": Transition(
                    guard=(above, "state", "mode", "u"), mode=(turned, "mode")
                ),
                "takes": Transition(
                    mode=(taken, "mode", "u"), period=period, offset=0.3 * delay
                ),
            },
        }
        rate, parameters = self._Pick([mixed, bent]), {"W": W}
        lag = {"rate": (rate, "W", "state", "u"), "parameters": parameters}
        channel = PacketNetwork(
            profile=DelayProfile(delay=delay),
            sample_period=period,
            jitter=Jitter(kind="gamma", std=0.02),
            loss=Loss(kind="independent", probability=0.2),
            seed=int(rng.integers(1000)),
            stream="here",
        )
        policy = self._Pick(["newest", "extrapolate"])
        profile = DelayProfile(
            delay=delay, sinusoid=Sinusoid(amplitude=delay / 3, frequency=5.0)
        )
        discrete = LinearSystem(W, I, I, np.zeros((N, N)), period)
        return self._Pick(
            [
                (ramp, False, False),
                (Own(("u",), outputs={"y": "state"}, **lag), False, False),
                (LinearSystem(W - 2 * I, I, I, np.zeros((N, N))), False, False),
                (Own(("u",), has_mode=True, **relay), False, False),
                (TransportDelay(delay=delay, size=N), False, True),
                (VariableDelay(profile=profile, size=N), False, True),
                (SampledDelay(delay=delay, size=N, sample_period=period), False, False),
                (
                    NetworkDelay(
                        network=channel, receiver=Receiver(policy=policy), size=N
                    ),
                    False,
                    False,
                ),
                (ZeroOrderHold(period, N), True, False),
                (discrete, True, False),
            ]
        )

    def _FeedThrough(self, builder, signals):
        """Adds what takes some of the signals, and returns its output."""
        rng, W = self._rng, self._Matrix()
        second = self._Pick([mixed, product])
        both = Own(
            ("u", "v"),
            outputs={"y": ["z", ("u", 1, 2)], "z": (first_two, "w"), "w": "rate"},
            sizes={"z": 2, "w": N},
            rate=(second, "W", "v", "u"),
            parameters={"W": W},
        )
        joined = Own(
            ("u", "v"),
            outputs={"y": (mixed, "W", ("b", 0, N), "w"), "w": (times, "u", "v")},
            sizes={"w": N},
            parameters={"W": W, "b": rng.normal(size=N + 2)},
        )
        system = self._Pick(
            [
                *(both, joined, joined, Adder(2, N), Gain(rng.normal(size=N))),
                *(MatrixGain(W), Saturation([-0.5] * N, [0.3] * N)),
                Sine(W[0], [2, 3, 4], W[1], False),
                AffineSystem(W - 2 * np.eye(N), W, W[0], W.T, W, W[1]),
                Multiplexer([1, 1, 1]),
                ConstantVectorSource(W[0]),
            ]
        )
        block = self._Add(builder, system)
        is_rough = isinstance(system, Saturation)
        for i in range(block.num_input_ports()):
            signal = self._Pick(signals)
            is_rough |= signal.is_rough
            port = signal.port
            if isinstance(system, Multiplexer):
                parts = self._Add(builder, Demultiplexer(N))
                builder.Connect(port, parts.get_input_port())
                port = parts.get_output_port((i + 1) % N)
            builder.Connect(port, block.get_input_port(i))
        return Signal(block.get_output_port(0), is_rough)


def first_two(w):
    return w[:2]
