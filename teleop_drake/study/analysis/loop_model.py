"""Linear models of the loop and of the two-port between hand and tool."""

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teleop_drake.loops.framework.arrays import Array, ComplexArray, Indices
from teleop_drake.loops.numerics.crossings import closed_loop_matrix
from teleop_drake.loops.numerics.state_space import StateSpace, state_space
from teleop_drake.study.analysis.operating_point import OperatingPoint

# The circles about 0 that MotionRate() examines: their number per decade, the number of
# decades below the fastest mode, and the points on the upper half of each circle. Roots
# inside of all circles are neutral in any case.
_NUM_CIRCLES = 6
_NUM_DECADES = 6
_NUM_ANGLES = 9

# A change of an entry of A counts as rounding below this share of the largest entry.
_ROUNDING = 1e-13

# Entries of B, C and D smaller than this, relative to the largest, are zero.
_NEGLIGIBLE = 1e-9


T = TypeVar("T")


class AtCuts(NamedTuple, Generic[T]):
    """An entry for each group of cuts that open the loop, in the order of the signals.

    Attributes:
        hand: Entry of the force at the operator's hand; empty in a LoopModel.
        tool: Entry of the force at the tool; empty in a LoopModel.
        forward: Entry of the forward channel.
        inner_slave: Entry of the delays inside of the slave.
        back: Entry of the return channel.
        inner_master: Entry of the delays inside of the master.
    """

    hand: T
    tool: T
    forward: T
    inner_slave: T
    back: T
    inner_master: T


Signals = AtCuts[Indices]
"""The indices of the model's signals at each group of cuts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopModel:
    """The linear model of the loop at an operating point, cut at all its delays.

    The loop is cut at its channels and at delays inside of the stations. Small
    deviations of the signals that enter the delays and of those that leave them obey

        entering = system(s) delivered,    delivered_i(t) = entering_i(t - T_i).

    Attributes:
        point: The operating point.
        system: The model from `delivered` to `entering`. Its states are those of the
            slave, [r (n), v (n), the states of controller and environment that are not
            frozen], and those of the master. A robot with more than n joints has
            [r, s, v, w] in place of [r, v]; see tool_motion.
        num_slave_states: Number of the slave's states.
        signals: Indices of the signals of each packet and of the inner delays.
        frozen_weights: Whether the estimates of an adaptive law are held constant.
        idle_passivity: Whether passivity controllers are assumed to inject nothing.
        inner_delays: The delays inside of the stations in s, an entry for each of their
            signals.
        motion: The change of the model along the motion of the operating point; None if
            the point is at rest.
        by_differences: Paths of the blocks that do not convert to AutoDiffXd. If there
            is one, all slopes are central differences.
        trim_residual: The largest of the tool's acceleration in m/s^2 and the rates of
            the states of controller and environment that trimming could not remove.
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
        """The slave's model, cut at its inner delays.

        Its inputs are [received forward packet; outputs of the inner delays], its
        outputs [sent return packet; inputs of the inner delays].
        """
        at = self.signals
        return self.system.part(
            states=np.arange(self.num_slave_states),
            inputs=np.append(at.forward, at.inner_slave),
            outputs=np.append(at.back, at.inner_slave),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """The change of a loop's model along the motion of the operating point.

    Attributes:
        behind: L shortly before the operating point; see CutLoop.
        ahead: L the same time after it.
        time: The time between the two in s.
    """

    behind: StateSpace
    ahead: StateSpace
    time: float

    def Rate(self, loop: StateSpace) -> float:
        """Returns the magnitude in 1/s below which roots are slower than the motion.

        It is the larger of two: that of the open loop and that of the loop closed
        without delay; see analysis.loop.

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
    """The linear model of the teleoperator between hand and environment.

    The haptic device and the environment are disconnected. The force F_h at the hand
    and the force F_e at the tool are inputs. The velocity that the hand feels and the
    tool's velocity are outputs:

        [v_felt, v, entering] = system(s) [F_h, F_e, delivered]

    Attributes:
        system: The model, cut at all delays.
        signals: Indices of the forces at the ports and of the signals of each delay.
        idle_passivity: Whether passivity controllers are assumed to inject nothing.
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

        Delays inside of the stations are set to the round trip, T_f + T_r.

        Args:
            frequencies: w in rad/s (K), > 0.
            forward_delay: T_f in s, >= 0.
            return_delay: T_r in s, >= 0.
        """
        n = len(self.signals.hand)
        delays = np.full(len(self.system.D), forward_delay + return_delay)
        delays[self.signals.forward] = forward_delay
        delays[self.signals.back] = return_delay
        # The first 2n signals are the forces at the ports, which stay open.
        delayed = replace(self.system, delays=tuple(delays[2 * n :]))
        y = delayed.frequency_response(frequencies)
        y[:, n:] *= -1
        return y


def CutLoop(model: LoopModel) -> StateSpace:
    """Returns L such that the loop's roots are those of det(I + L(s) e^(-s T)) = 0.

    The loop is cut at one channel, the one with fewer relevant signals. These are the
    entries of the return packet that act on the master, or the entries of the forward
    packet that depend on the return packet and act on the slave. Delays inside of the
    stations are cut in any case.

    Args:
        model: The loop at an operating point. Delays inside of the stations are T.

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
    # The other channel is closed without delay: the channel that is cut has the whole
    # round trip.
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
    """Returns a loop with the same det(I + L z) and the fewest signals.

    Inputs that act only in fixed combinations are merged by
    det(I + P V^T z) = det(I + V^T P z). Examples are v_ret and -v_model(t - T) of a
    predictor, and position, velocity and force on the handle of a four-channel master.
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
    """Returns the magnitude in 1/s below which roots of A(t) are slower than A(t).

    It is the radius of the smallest circle about 0 on which no z is an eigenvalue of
    A + h A'/|z| with |h| <= 1: the spectral radius of (z I - A)^-1 A' is less than |z|
    on the circle. If this is the first circle that is examined, the result is 0.

    Args:
        A: The system matrix in 1/s (n, n).
        A_dot: Its rate A' in 1/s^2 (n, n).
    """
    modes = np.linalg.eigvals(A).astype(complex)
    fastest = float(np.abs(modes).max(initial=0.0))
    if fastest == 0 or not np.any(A_dot):
        return 0.0
    smallest = fastest * 10.0**-_NUM_DECADES
    radii = np.geomspace(smallest, fastest, _NUM_DECADES * _NUM_CIRCLES + 1)
    # The directions of the modes are included, so that no mode lies between two points.
    angles = np.concatenate([np.linspace(0, np.pi, _NUM_ANGLES), np.angle(modes)])
    directions = np.exp(1j * angles)[:, None, None] * np.eye(len(A))
    for k, radius in enumerate(radii):
        try:
            moved = np.linalg.solve(radius * directions - A, A_dot)
        except np.linalg.LinAlgError:  # A point is exactly an eigenvalue of A.
            continue
        if np.abs(np.linalg.eigvals(moved)).max() < radius:
            return float(radius) if k else 0.0
    return fastest
