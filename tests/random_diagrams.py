"""Diagrams at random: kernels and Drake's primitives in loops, nested, with events.

Signals have three numbers each. What holds or delays comes first, so that there is
something to take; then what feeds through, one after another; at last the inputs of the
first ones are connected, to anything. So there are loops, none of them algebraic.

Signals stay of the size of 1: states relax, and what goes into a loop is limited.
A delay takes no signal that is rough: nothing ends a step where a Saturation begins.
"""

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    AffineSystem,
    Gain,
    LinearSystem,
    MatrixGain,
    PassThrough,
    Saturation,
    Sine,
    ZeroOrderHold,
)

from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile, Sinusoid, VariableDelay
from teleop_drake.loops.kernel import FixedBlock, Kernel, Transition, times

N = 3
END = 1.0
I = np.eye(N)
ZERO = np.zeros((N, N))
ROUGH = (Saturation,)
TAKES_SMOOTH = TransportDelay, VariableDelay


def bent(W, x, u):
    result = -0.5 * x
    for i in range(N):
        if u[i] > x[i]:
            result[i] += (u[i] - x[i]) ** 2 / (1 + abs(u[i]))
    return result + 0.3 * np.sin(W @ x)


def mixed(W, x, u):
    return np.tanh(W @ u) * (1 + W @ x) - x


def Own(*inputs, mode=(), **kernel):
    """Returns a block with a kernel; its mode is a sign, a count, and a sample."""
    sizes = dict.fromkeys(inputs, N)
    state = [0.5, -0.2, 0.1]
    state = state if kernel.get("rate") else ()
    kernel = Kernel(**kernel)
    block = FixedBlock("own", kernel, inputs=sizes, outputs={"y": N}, state=state)
    if mode:
        block.DeclareDiscreteState(mode)
    return block


def Relay(W, delay, period):
    turns = Transition(
        guard=(lambda x, mode: mode[:1] * x[:1] - 0.3, "state", "mode"),
        mode=(lambda mode: np.array([-mode[0], mode[1] + 1, *mode[2:]]), "mode"),
    )
    takes = Transition(
        mode=(lambda mode, u: np.array([*mode[:2], *np.tanh(u)]), "mode", "u"),
        period=period,
        offset=0.3 * delay,
    )
    return Own(
        "u",
        mode=[1.0, *np.zeros(N + 1)],
        rate=(
            lambda k, x, mode, u: mode[0] * k - x + 0.2 * np.tanh(u),
            *("k", "state", "mode", "u"),
        ),
        outputs={"y": (lambda x, mode: x + 0.1 * mode[2:], "state", "mode")},
        parameters={"k": 1 + 0.2 * np.tanh(W[0])},
        transitions={"turns": turns, "takes": takes},
    )


def Network(W, delay, period):
    network = PacketNetwork(
        profile=DelayProfile(delay=delay),
        sample_period=period,
        jitter=Jitter(kind="gamma", std=0.02),
        loss=Loss(kind="independent", probability=0.2),
        seed=int(1000 * abs(W[0, 0])),
        stream="here",
    )
    receiver = Receiver(policy="newest" if W[0, 1] > 0 else "extrapolate")
    return NetworkDelay(network=network, receiver=receiver, size=N)


def Nested(W, delay, period):
    """Outputs a part of its rate, by way of other values."""
    return Own(
        *("u", "v"),
        outputs={
            "y": ["z", ("u", 1, 2)],
            "z": (lambda w, p: p[1:] * w[:2], "w", "p"),
            "w": "rate",
            "p": (times, "u", "v"),
        },
        sizes={"z": 2, "w": N, "p": N},
        rate=(mixed, "W", ("b", 1, N + 1), "u"),
        parameters={"W": W, "b": np.ravel(W)[:5]},
    )


# Of a matrix, a delay and a period in s: what holds or delays, and what feeds through.
HOLDING = [
    *(Relay, Relay, Network, Network),
    lambda W, *_: Own(
        outputs={"y": (lambda t, z: np.cos((4 + t) * t + z), "time", "z")},
        parameters={"z": W[0]},
    ),
    lambda W, *_: Own(
        "u",
        outputs={"y": "state"},
        rate=(bent, "W", "state", "u"),
        parameters={"W": W},
    ),
    lambda W, delay, period: VariableDelay(
        profile=DelayProfile(
            delay=delay, sinusoid=Sinusoid(amplitude=delay / 3, frequency=5.0)
        ),
        size=N,
    ),
    lambda W, delay, period: LinearSystem(W - 2 * I, I, I, ZERO),
    lambda W, delay, period: TransportDelay(delay=delay, size=N),
    lambda W, delay, period: SampledDelay(delay=delay, size=N, sample_period=period),
    lambda W, delay, period: ZeroOrderHold(period, N),
    lambda W, delay, period: AffineSystem(W, I, W[0], I, ZERO, W[1], period),
]
FEEDING_THROUGH = [
    *(Nested, Nested, Nested),
    lambda W, *_: Adder(2, N),
    lambda W, *_: Gain(2 * W[0]),
    lambda W, *_: MatrixGain(W),
    lambda W, *_: Saturation([-0.5] * N, [0.3] * N),
    lambda W, *_: Sine(W[0], [2, 3, 4], W[1], False),
    lambda W, *_: LinearSystem(W - 2 * I, W, W.T, W),
]


class Random:
    """Makes one diagram, of a seed. Signals are ports, and whether they are rough."""

    def __init__(self, seed):
        self._rng = np.random.default_rng(seed)
        self._count = 0

    def Make(self, num_blocks=6, depth=2, outer=()):
        """Returns a diagram and its outputs.

        Args:
            outer: The signals for its inputs. None of them is connected here.
        """
        builder = DiagramBuilder()
        rng = self._rng
        waves = Sine(rng.normal(size=N), [3, 5, 7], rng.normal(size=N), True)
        signals = [(self._Add(builder, waves).get_output_port(0), False)]
        for i, (_, is_rough) in enumerate(outer):
            block = self._Add(builder, PassThrough(N))
            builder.ExportInput(block.get_input_port(), f"u{i}")
            if rng.random() < 0.5:  # One input of the diagram, two in it.
                block = self._Add(builder, Gain(0.8, N))
                builder.ConnectInput(f"u{i}", block.get_input_port())
            signals.append((block.get_output_port(), is_rough))
        holding = [self._AddOne(builder, HOLDING) for _ in range(num_blocks // 2)]
        signals += [(x.get_output_port(0), isinstance(x, ROUGH)) for x in holding]
        for k in range(num_blocks - num_blocks // 2):
            if depth and k % 2:
                taken = [self._Pick(signals) for _ in range(rng.integers(1, 3))]
                part = Random(int(rng.integers(2**31)))
                inner, outputs = part.Make(num_blocks - 2, depth - 1, taken)
                builder.AddNamedSystem(f"inner_{k}", inner)
                for i, (port, _) in enumerate(taken):
                    builder.Connect(port, inner.get_input_port(i))
                signals += [
                    (inner.get_output_port(i), is_rough)
                    for i, (_, is_rough) in enumerate(outputs)
                ]
            else:
                block = self._AddOne(builder, FEEDING_THROUGH)
                is_rough = isinstance(block, ROUGH)
                for i in range(block.num_input_ports()):
                    port, is_too = self._Pick(signals)
                    is_rough |= is_too
                    builder.Connect(port, block.get_input_port(i))
                signals.append((block.get_output_port(0), is_rough))
        for block in holding:
            smooth = isinstance(block, TAKES_SMOOTH)
            given = [x for x in signals if not (smooth and x[1])]
            for i in range(block.num_input_ports()):
                bounded = {"y": (lambda u: 2 * np.tanh(u / 2), "u")}
                limit = self._Add(builder, Own("u", outputs=bounded))
                builder.Connect(self._Pick(given)[0], limit.get_input_port())
                builder.Connect(limit.get_output_port(), block.get_input_port(i))
        outputs = signals[-3:] if outer else signals
        for i, (port, _) in enumerate(outputs):
            builder.ExportOutput(port, f"y{i}")
        return builder.Build(), outputs

    def _Pick(self, items):
        return items[self._rng.integers(len(items))]

    def _Add(self, builder, system):
        self._count += 1
        return builder.AddNamedSystem(f"{type(system).__name__}_{self._count}", system)

    def _AddOne(self, builder, makers):
        """Adds a block by one of those that make one."""
        W = 0.5 * self._rng.normal(size=(N, N))
        delay = float(self._Pick([0.1, 0.2, 0.17, self._rng.uniform(0.05, 0.3)]))
        period = float(self._Pick([0.1, 0.05, 0.07, self._rng.uniform(0.04, 0.2)]))
        # The channels ask for a period that is no longer than the delay.
        return self._Add(builder, self._Pick(makers)(W, delay, min(period, delay)))
