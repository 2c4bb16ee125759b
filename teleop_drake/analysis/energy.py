"""Energy at both ends of the channels, and what the surgeon feels through them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer

from teleop_drake.analysis.linearization import EMPTY, LoopModel
from teleop_drake.laws.interpolation import NUM_STENCIL_POINTS
from teleop_drake.recording import Recording
from teleop_drake.scenario import Scenario
from teleop_drake.systems.channel_energy import ChannelEnergy

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# The product of two of the recording's polynomials is integrated exactly.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(NUM_STENCIL_POINTS)


@dataclass(frozen=True, kw_only=True, eq=False)
class EnergyBalance:
    """What goes into the channels and what comes out of them, over a run.

    Attributes:
        time: (N,) the recording's in s.
        power_in: (N,) F_m . v_m at the master in W.
        power_out: (N,) F_s . v_s at the slave in W.
        energy: (N,) integral of power_in - power_out in J, 0 at the start.
    """

    time: Array
    power_in: Array
    power_out: Array
    energy: Array

    @property
    def violation(self) -> Array:
        """Energy in J that the channels have made themselves by each time (N).

        The largest deficit so far; it is 0 as long as they are passive.
        """
        return np.maximum.accumulate(np.maximum(-self.energy, 0.0))


def ChannelEnergyBalance(
    recording: Recording,
    *,
    force: slice | None = None,
    velocity: slice | None = None,
) -> EnergyBalance:
    """Balances the energy of the channels of a recorded run.

    The same as systems.ChannelEnergy in the diagram, afterwards: between two samples
    the recording's own interpolation is integrated exactly. What a sampled or network
    channel delivers jumps between two samples, and is known to a step only.

    Args:
        recording: A run of a teleoperation.
        force: Where the forward packet has its force; None: its first half, as in
            the thesis's packet [F_h; v_d].
        velocity: Where the return packet has its velocity; None: its second half, as in
            [p_WT; v_WT].

    Raises:
        ValueError: If it is the recording of something else, or the parts of the
            packets are not as many as there are axes.
    """
    n = recording["tool_velocity"].shape[1]
    names = ("forward_packet_sent", "return_packet_received")
    if any(name not in recording.signals for name in names):
        raise ValueError("recording: no packets; allowed: a run of a teleoperation")
    parts = []
    for packet, part, default in (
        ("forward_packet", force, slice(0, n)),
        ("return_packet", velocity, slice(n, 2 * n)),
    ):
        width = recording[f"{packet}_sent"].shape[1]
        if part is None and width != 2 * n:
            raise ValueError(
                f"recording: its {packet} has {width} entries; allowed: {2 * n}, or "
                "say where its force and velocity are"
            )
        part = default if part is None else part
        if len(range(width)[part]) != n:
            raise ValueError(
                f"{packet}: {len(range(width)[part])} entries chosen; allowed: {n}"
            )
        parts.append(part)
    forces, velocities = parts

    time = recording.time
    begin, end = time[:-1], time[1:]
    middle, half = (begin + end) / 2, (end - begin) / 2
    is_piece = half > 0
    nodes = (middle[is_piece, None] + half[is_piece, None] * _NODES).ravel()

    def Powers(sent: Array, felt: Array, received: Array, own: Array) -> list[Array]:
        return [
            np.sum(sent[:, forces] * felt[:, velocities], axis=1),
            np.sum(received[:, forces] * own[:, velocities], axis=1),
        ]

    signals = (
        "forward_packet_sent",
        "return_packet_received",
        "forward_packet_received",
        "return_packet_sent",
    )
    power_in, power_out = Powers(*(recording[name] for name in signals))
    inner_in, inner_out = Powers(
        *(recording.Interpolate(name, nodes) for name in signals)
    )
    work = np.zeros(len(time))
    pieces = (inner_in - inner_out).reshape(-1, len(_NODES)) @ _WEIGHTS
    work[1:][is_piece] = pieces * half[is_piece]
    return EnergyBalance(
        time=time, power_in=power_in, power_out=power_out, energy=np.cumsum(work)
    )


def AddChannelEnergy(
    builder: DiagramBuilder,
    *,
    num_axes: int,
    forward_sent: OutputPort,
    forward_received: OutputPort,
    return_sent: OutputPort,
    return_received: OutputPort,
) -> ChannelEnergy:
    """Adds a ChannelEnergy, with what takes the thesis's packets apart for it.

    Args:
        builder: Of the diagram with the loop.
        num_axes: n.
        forward_sent: Packet [F_h; v_d] (2n) at the master.
        forward_received: The same at the slave.
        return_sent: Packet [p_WT; v_WT] (2n) at the slave.
        return_received: The same at the master.

    Returns:
        The system, whose output ports are energy and power.
    """
    n = num_axes
    meter = builder.AddNamedSystem("channel_energy", ChannelEnergy(num_axes=n))
    for i, (port, name) in enumerate(
        (
            (forward_sent, "master_force"),
            (forward_received, "slave_force"),
            (return_received, "master_velocity"),
            (return_sent, "slave_velocity"),
        )
    ):
        unpack = builder.AddNamedSystem(f"unpack_{name}", Demultiplexer([n, n]))
        builder.Connect(port, unpack.get_input_port())
        builder.Connect(unpack.get_output_port(i // 2), meter.GetInputPort(name))
    return meter


def TransmittedImpedance(
    model: LoopModel, frequencies: ArrayLike, *, delay: float = 0.0
) -> ComplexArray:
    """Returns the impedance that the surgeon feels through the channels (K, n, n).

        Z_to(j w) = G_vF(j w)^-1 e^(j w T),   F_h = Z_to v(t - T_r)

    with the slave's G_vF from the force received to the velocity sent. With direct
    force and no delay that is the robot's impedance and the environment's. The delay
    turns its phase: Re Z_to < 0 where the surgeon is given energy. (Z_to itself is not
    causal, its inverse is: the surgeon applies a force and feels a velocity.)

    Args:
        model: The loop at an operating point, its packets those of the thesis.
        frequencies: w in rad/s (K), > 0.
        delay: Round-trip delay T in s.

    Raises:
        ValueError: If the packets are not those of the thesis.
    """
    n = len(model.point.position)
    if model.slave.D.shape != (2 * n, 2 * n):
        raise ValueError(
            f"model: packets of {model.slave.D.shape} entries; allowed: {2 * n} each"
        )
    w = np.asarray(frequencies, dtype=float).reshape(-1)
    admittance = model.slave.FrequencyResponse(w)[:, n:, :n]
    phase = np.exp(1j * w * delay)[:, None, None]
    return (np.linalg.inv(admittance) * phase).astype(complex)


def EnvironmentImpedance(
    scenario: Scenario, model: LoopModel, frequencies: ArrayLike
) -> ComplexArray:
    """Returns Z_e(j w) = d_e + k_e/(j w) of the layer, along x (K, n, n), (2.14).

    Args:
        scenario: With the layers.
        model: The loop at an operating point, which says the layer.
        frequencies: w in rad/s (K), > 0.
    """
    w = np.asarray(frequencies, dtype=float).reshape(-1)
    n = len(model.point.position)
    impedance = np.zeros((len(w), n, n), dtype=complex)
    if model.point.layer != EMPTY:
        (layer,) = [
            layer
            for layer in scenario.environment.layers
            if layer.name == model.point.layer
        ]
        impedance[:, 0, 0] = layer.damping + layer.stiffness / (1j * w)
    return impedance
