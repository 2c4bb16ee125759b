"""Linear models of both ends of the loop and of the two-port between hand and tool."""

from dataclasses import dataclass

from teleop_drake.linear_model.operating_point import OperatingPoint
from teleop_drake.numerics.state_space import StateSpace


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopModel:
    """The loop, cut at its channels, at an operating point.

    Small deviations obey, with the delays T_f and T_r,

        return packet  = slave(s) forward packet(t - T_f)
        forward packet = master(s) return packet(t - T_r)

    Attributes:
        point: The operating point.
        master: From the return packet received to the forward packet sent, followed by
            one input and one output for each internal delay of the master.
        slave: From the forward packet received to the return packet sent, followed by
            one input and one output for each internal delay of the slave. Its states
            are [r (n), v (n), the states of the controller that are not frozen]; a
            robot with more joints has [r, s, v, w] in the place of [r, v], see
            linear_model.tool_motion.
        frozen_weights: Whether the estimates of an adaptive law are held constant.
        idle_passivity: Whether passivity controllers are taken to inject nothing.
        packet_sizes: Entries of the forward and of the return packet.
        inner_delays: The delays inside, in s: first the master's, an entry for each of
            their signals.
        motion: How the model changes while the operating point moves on; None: it
            rests.
        by_differences: Paths of the blocks that do not convert to AutoDiffXd, whose
            slopes come from differences.
        trim_residual: Largest rate of the tool's velocity, in m/s^2, and of the
            controller's states: what no choice of the forward packet could remove, or,
            where the point has one, what it is.
    """

    point: OperatingPoint
    master: StateSpace
    slave: StateSpace
    frozen_weights: bool
    idle_passivity: bool
    packet_sizes: tuple[int, int]
    inner_delays: tuple[float, ...]
    motion: "Motion | None"
    by_differences: tuple[str, ...]
    trim_residual: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """How the model of a loop changes while the operating point moves on.

    Attributes:
        rate: The size in 1/s below which roots are slower than the motion; see
            linear_model.loop.
        loops: L a time before the point and the same time after it; see loop_cut.
        time: Between the two, in s.
    """

    rate: float
    loops: tuple[StateSpace, StateSpace]
    time: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoPortModel:
    """The teleoperator between the operator's hand and the environment.

    It has neither the haptic device nor the environment of LoopModel: the force F_h at
    the hand and the force F_e at the tool are inputs, and the velocity that the hand
    feels and the tool's are outputs. They stand before the others:

        [v_felt, forward packet, inner] = master(s) [F_h, return packet, inner]
        [v, return packet, inner]       = slave(s) [F_e, forward packet, inner]

    Attributes:
        point: The operating point.
        master: The operator's hand and the master side.
        slave: The slave side and the robot.
        idle_passivity: As in LoopModel.
        packet_sizes: As in LoopModel.
        inner_delays: As in LoopModel.
    """

    point: OperatingPoint
    master: StateSpace
    slave: StateSpace
    idle_passivity: bool
    packet_sizes: tuple[int, int]
    inner_delays: tuple[float, ...]
