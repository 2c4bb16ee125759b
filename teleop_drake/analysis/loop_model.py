"""Linear models of the loop and of the two-port between hand and tool."""

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.analysis.operating_point import OperatingPoint
from teleop_drake.arrays import Array, ComplexArray, Indices
from teleop_drake.numerics.crossings import closed_loop_matrix
from teleop_drake.numerics.state_space import StateSpace, state_space

# Circles about 0 that are looked at: how many in a decade, how many decades below the
# fastest mode, and how many points on the upper half of each. What is slower than all
# circles is neutral in any case.
_NUM_CIRCLES = 6
_NUM_DECADES = 6
_NUM_ANGLES = 9

# Entries of A that change by less, as a share of the largest, do not: rounding.
_ROUNDING = 1e-13

# Entries of B, C and D smaller than this, relative to the largest, are zero.
_NEGLIGIBLE = 1e-9


T = TypeVar("T")


class AtCuts(NamedTuple, Generic[T]):
    """Something for each of the cuts that open the loop, in the order of its signals.

    Attributes:
        hand: The force at the operator's hand; empty for the loop.
        tool: The force at the tool; empty for the loop.
        forward: The forward channel.
        inner_slave: Delays in the slave.
        back: The return channel.
        inner_master: Delays in the master.
    """

    hand: T
    tool: T
    forward: T
    inner_slave: T
    back: T
    inner_master: T


Signals = AtCuts[Indices]
"""Which of the signals of a model are delivered at which cut."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopModel:
    """The loop, cut at its channels and at delays inside, at an operating point.

    Small deviations of what the delays deliver, each its T_i later, and of what enters
    them obey

        entering = system(s) delivered,    delivered_i(t) = entering_i(t - T_i).

    Attributes:
        point: The operating point.
        system: From what is delivered to what enters. Its states are the slave's,
            [r (n), v (n), the states of controller and environment that are not
            frozen], and the master's; a robot with more joints has [r, s, v, w] in the
            place of [r, v], see tool_motion.
        num_slave_states: How many states are the slave's.
        signals: Which signals are of the packets, and which of delays inside.
        frozen_weights: Whether the estimates of an adaptive law are held constant.
        idle_passivity: Whether passivity controllers are taken to inject nothing.
        inner_delays: The delays inside, in s, an entry for each of their signals.
        motion: How the model changes while the operating point moves on; None: it
            rests.
        by_differences: Paths of the blocks that do not convert to AutoDiffXd, whose
            slopes come from differences.
        trim_residual: Largest rate of the tool's velocity, in m/s^2, and of the
            controller's states: what no choice of the forward packet could remove.
    """

    point: OperatingPoint
    system: StateSpace
    num_slave_states: int
    signals: Signals
    frozen_weights: bool
    idle_passivity: bool
    inner_delays: tuple[float, ...]
    motion: "Motion | None"
    by_differences: tuple[str, ...]
    trim_residual: float

    @property
    def slave(self) -> StateSpace:
        """From [forward packet received, delivered inside] to [return packet, inside].

        The return packet is the one that is sent.
        """
        at = self.signals
        return self.system.part(
            states=np.arange(self.num_slave_states),
            inputs=np.append(at.forward, at.inner_slave),
            outputs=np.append(at.back, at.inner_slave),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """How the model of a loop changes while the operating point moves on.

    Attributes:
        behind: L a time before the point; see CutLoop.
        ahead: L the same time after it.
        time: Between the two, in s.
    """

    behind: StateSpace
    ahead: StateSpace
    time: float

    def Rate(self, loop: StateSpace) -> float:
        """Returns the size in 1/s below which roots are slower than the motion.

        It is that of both ends or of the loop that is closed without delay, whichever
        is larger; see analysis.loop.

        Args:
            loop: L at the point.
        """
        rates = []
        for matrix_of in (attrgetter("A"), closed_loop_matrix):
            here = matrix_of(loop)
            change = matrix_of(self.ahead) - matrix_of(self.behind)
            change[np.abs(change) <= _ROUNDING * np.abs(here).max(initial=0.0)] = 0.0
            rates.append(MotionRate(here, change / self.time))
        return max(rates)


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoPortModel:
    """The teleoperator between the operator's hand and the environment.

    Haptic device and environment do not act on it: the force F_h at the hand and the
    force F_e at the tool are inputs, and the velocity that the hand feels and the
    tool's are outputs:

        [v_felt, v, entering] = system(s) [F_h, F_e, delivered]

    Attributes:
        system: As above.
        signals: Which of the signals are forces at the ports or pass which delay.
        idle_passivity: As in LoopModel.
    """

    system: StateSpace
    signals: Signals
    idle_passivity: bool

    def Admittance(
        self,
        frequencies: ArrayLike,
        *,
        forward_delay: float = 0.0,
        return_delay: float = 0.0,
    ) -> ComplexArray:
        """Returns y(j w) (K, 2n, 2n) of [v_felt; -v] = y [F_h; F_e].

        Delays inside of the stations are the round trip, T_f + T_r.

        Args:
            frequencies: w in rad/s (K), > 0.
            forward_delay: T_f in s, >= 0.
            return_delay: T_r in s, >= 0.
        """
        n = len(self.signals.hand)
        delays = np.full(len(self.system.D), forward_delay + return_delay)
        delays[self.signals.forward] = forward_delay
        delays[self.signals.back] = return_delay
        # Those of the forces at the ports count for nothing.
        delayed = replace(self.system, delays=tuple(delays[2 * n :]))
        y = delayed.frequency_response(frequencies)
        y[:, n:] *= -1
        return y


def CutLoop(model: LoopModel) -> StateSpace:
    """Returns L, such that the loop has the roots of det(I + L(s) e^(-s T)).

    The loop is cut where fewer signals cross: among the entries of the return packet
    that the master listens to, or those of the forward packet that depend on them and
    act on the slave. Delays inside of the stations are cut in any case.

    Args:
        model: The loop at an operating point; delays inside of it, if any, are T.

    Returns:
        L, not minimal: its states are those of the slave and of the master.
    """
    system = model.system
    forward = model.signals.forward
    back = model.signals.back
    by_input = system.matrix[:, system.num_states :]
    by_output = system.matrix[system.num_states :]
    heard = back[_Nonzero(by_input[:, back].T)]
    acts = _Nonzero(by_output[forward]) & _Nonzero(by_input[:, forward].T)
    sent = forward[acts]
    # What is closed passes without delay, for the other one has all of it.
    if len(heard) <= len(sent):
        closed = forward
        crossing = heard
    else:
        closed = back
        crossing = sent
    inside = (model.signals.inner_slave, model.signals.inner_master)
    signals = np.concatenate([closed, crossing, *inside])
    kept = system.part(np.arange(system.num_states), signals, signals)
    return _MergeInputs(-kept.closed(np.arange(len(closed))))


def _MergeInputs(loop: StateSpace) -> StateSpace:
    """Returns a loop with the same det(I + L z), with the fewest signals.

    Inputs that always act together, as v_ret and -v_model(t - T) of a predictor do, or
    position, velocity and force on the handle of four channels, are one:
    det(I + P V^T z) = det(I + V^T P z).
    """
    by_input = loop.matrix[:, loop.num_states :]
    _, sigma, Vt = np.linalg.svd(by_input, full_matrices=False)
    V = Vt[sigma > _NEGLIGIBLE * sigma.max(initial=1e-300)].T
    if V.shape[0] == V.shape[1]:
        return loop
    return state_space(loop.A, loop.B @ V, V.T @ loop.C, V.T @ loop.D @ V)


def _Nonzero(rows: Array) -> NDArray[np.bool_]:
    """Returns for each row whether it is not zero."""
    sizes = np.abs(rows).max(axis=1, initial=0.0)
    return sizes > _NEGLIGIBLE * sizes.max(initial=1e-300)


def MotionRate(A: Array, A_dot: Array) -> float:
    """Returns the size in 1/s below which the roots of A(t) are slower than its motion.

    It is the radius of the smallest circle about 0 on which no z is an eigenvalue of
    A + h A'/|z| with |h| <= 1: on which the spectral radius of (z I - A)^-1 A' is less
    than |z|. 0 if that is the first circle that is looked at.

    Args:
        A: (n, n), in 1/s.
        A_dot: A', its rate (n, n), in 1/s^2.
    """
    modes = np.linalg.eigvals(A).astype(complex)
    fastest = float(np.abs(modes).max(initial=0.0))
    if fastest == 0 or not np.any(A_dot):
        return 0.0
    smallest = fastest * 10.0**-_NUM_DECADES
    radii = np.geomspace(smallest, fastest, _NUM_DECADES * _NUM_CIRCLES + 1)
    # The directions of the modes, too: none slips through between two points.
    angles = np.concatenate([np.linspace(0, np.pi, _NUM_ANGLES), np.angle(modes)])
    directions = np.exp(1j * angles)[:, None, None] * np.eye(len(A))
    for k, radius in enumerate(radii):
        try:
            moved = np.linalg.solve(radius * directions - A, A_dot)
        except np.linalg.LinAlgError:  # A root to the last digit.
            continue
        if np.abs(np.linalg.eigvals(moved)).max() < radius:
            return float(radius) if k else 0.0
    return fastest
