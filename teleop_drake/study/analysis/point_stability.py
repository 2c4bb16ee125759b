"""The delay margins of the loop at an operating point.

The loop has only one delay, T = T_f + T_r. All signals from the operator to the robot
cross the forward channel, and all signals back cross the return channel. Each channel
has the same delay for all entries of a packet. So with slave S(s) and master M(s)

    det(I - S(s) e^(-s T_f) M(s) e^(-s T_r)) = det(I - S(s) M(s) e^(-s T)) = 0,

and unequal delays with the same sum give the same roots. (This holds beyond the linear
model: with the slave's clock set back by T_f, the forward channel has no delay and the
return channel has the whole delay.) L has only those entries of the packets that the
other side uses. The loop is cut on the side where these are fewer, and entries that
always act together count as one. With one axis L is therefore scalar.

A Smith predictor contains a delay that should be the round trip. This delay is cut as
well and set to T at every T. A loop with a second delay that differs from T is refused.

Roots that are at 0 for every delay are neutral and do not count as an instability. They
describe the position of the tool, or how far the operator's device has been wound up
against a spring. In velocity mode there is one neutral root per axis: the tool's
position and the device's integral of the felt velocity both integrate v, so that their
sum is constant. With the thesis's packets this root is hidden in L and is removed with
all other hidden modes. With packets that carry a force back it appears in L, and
delay_margin handles it. Any other hidden mode on or right of the imaginary axis makes
the loop unstable at every delay.

The model describes one instant of the operating point's motion (analysis.loop).
Roots slower than that motion do not count; see PointStability.unresolved.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teleop_drake.loops.framework.arrays import ComplexArray, Interval, Record
from teleop_drake.loops.numerics.characteristic_roots import (
    characteristic_roots,
    rightmost,
)
from teleop_drake.loops.numerics.crossings import Crossing, closed_loop_matrix
from teleop_drake.loops.numerics.delayed_loop import loop_frequencies, stable_gains
from teleop_drake.loops.numerics.state_space import StateSpace, minimal_realization
from teleop_drake.study.analysis.loop_model import CutLoop, LoopModel, Motion
from teleop_drake.study.numerics.delay_margin import (
    delay_margin,
    find_crossings,
    is_delay_robust,
    neutral_root_count,
    stable_delays,
    unstable_roots,
)

MAX_DELAY = 2.0
"""The default upper end of the reported intervals of round-trip delays, in s."""

# A hidden mode this close to the imaginary axis, relative to its size, is on it.
_ON_AXIS = 1e-9

# A root this close to 0, relative to the fastest mode, may be a neutral one.
_NEUTRAL = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class PointStability:
    """Stability of the loop at one operating point.

    Attributes:
        model: The linear models of both ends.
        loop: L, minimal: the roots are those of det(I + L(s) e^(-s T)).
        delay: Round-trip delay of the scenario in s.
        max_delay: The largest round-trip delay of stable_delays, in s.
        crossings: The crossings of the imaginary axis, by ascending frequency.
        margin: The crossing at which the loop first becomes unstable as the delay
            grows from 0; None if there is none, or the loop is unstable without delay.
        stable_delays: Every interval of round-trip delays at which the loop is stable,
            in s. An interval that ends at max_delay may extend beyond it.
        hidden_modes: Modes that do not appear in L, in 1/s, without neutral ones.
        num_neutral: Number of roots without delay that cannot be distinguished from 0,
            including hidden ones.
        unresolved: The magnitude in 1/s below which roots and crossings do not count:
            they are slower than the motion of the operating point, or 0 to rounding.
        slave_root: The rightmost root of the slave alone, in 1/s, without neutral ones.
            It describes the loop while the slave receives nothing. It is None if the
            slave has only neutral roots.
        force_mode: The loop on the contact surface after the operator has perceived
            contact and holds a force, at the point where the tool then rests. It is
            None if the operator does not change its behaviour, or if there is no model
            for the reason in `untold`.
        untold: The reason why there is no model of the loop after contact; empty if
            there is one, or if the operator does not change its behaviour.
    """

    model: LoopModel
    loop: StateSpace
    delay: float
    max_delay: float
    crossings: list[Crossing]
    margin: Crossing | None
    stable_delays: list[Interval]
    hidden_modes: ComplexArray
    num_neutral: int
    unresolved: float
    slave_root: complex | None
    force_mode: "PointStability | None" = None
    untold: str = ""

    @property
    def operator(self) -> str:
        """The behaviour of the operator in this loop."""
        holds_force = self.model.point.holds_force
        return "holds a force" if holds_force else "commands a velocity"

    @property
    def label(self) -> str:
        """The name of the operating point, and whether a force is held there."""
        name = self.model.point.name
        return f"{name}, force held" if self.model.point.holds_force else name

    @property
    def is_stable(self) -> bool:
        """Whether the loop is stable at the scenario's delay."""
        return self.IsStableWith(self.delay)

    def IsStableWith(self, delay: float) -> bool:
        """Returns whether the loop is stable at a delay, by counting crossings.

        Args:
            delay: Round-trip delay in s.
        """
        if not _AllDecay(self.hidden_modes):
            return False
        if delay > 0 and not is_delay_robust(self.loop):
            return False
        _, counts = unstable_roots(self.loop, delay, self.crossings, self.unresolved)
        return int(counts[-1]) == 0

    def Roots(self, delay: float, count: int = 8) -> ComplexArray:
        """Returns the rightmost characteristic roots, by descending real part.

        They come from collocation (characteristic_roots), not from the frequency
        response, and include the hidden modes but not the neutral roots.

        Args:
            delay: Round-trip delay in s.
            count: The largest number of roots.
        """
        more = count + self.num_neutral
        roots = characteristic_roots(self.loop.fed_back(delay), count=more)
        # Collocation finds the roots that are at 0 at every delay only to its accuracy.
        slow = _NEUTRAL * float(np.linalg.norm(self.loop.A))
        roots = roots[np.abs(roots) >= max(slow, self.unresolved)]
        roots = np.concatenate([roots, self.hidden_modes])
        return rightmost(roots)[:count]

    def RightmostRoot(self, delay: float) -> complex | None:
        """Returns the rightmost characteristic root in 1/s; of a pair, the upper one.

        The result is None if there is no root, if roots tend to infinity because of D,
        or if the root is too fast for collocation, which then gives it the wrong sign.

        Args:
            delay: Round-trip delay in s.
        """
        if delay > 0 and not is_delay_robust(self.loop):
            return None
        roots = self.Roots(delay, count=2)
        if not len(roots):
            return None
        root = complex(roots[0])
        is_clear = abs(root.real) > _NEUTRAL * max(abs(root), 1e-300)
        if is_clear and (root.real < 0) != self.IsStableWith(delay):
            return None
        return root

    @cached_property
    def rightmost_root(self) -> complex | None:
        """RightmostRoot() at the scenario's delay."""
        return self.RightmostRoot(self.delay)

    @cached_property
    def stable_gains(self) -> list[Interval]:
        """The gains with which the loop would be stable at the scenario's delay.

        It is empty if the loop is stable there. The gain multiplies all signals that
        return through the channels; see Margins.stable_gains.
        """
        if self.is_stable or not _AllDecay(self.hidden_modes):
            return []
        loop = self.loop.behind(self.delay) if self.delay > 0 else self.loop
        return stable_gains(loop, loop_frequencies(loop), self.unresolved)

    def ToRecord(self) -> Record:
        """Returns the JSON object of `teleop-drake analyze`, without NaN."""
        point = self.model.point
        margin = self.margin
        return {
            "name": point.name,
            "position": point.position.tolist(),
            "velocity": point.velocity.tolist(),
            "layer": point.name,
            "operator": self.operator,
            "frozen_weights": self.model.frozen_weights,
            "idle_passivity": self.model.idle_passivity,
            "gain_crossovers": [crossing.frequency for crossing in self.crossings],
            "crossing_delays": [crossing.delay for crossing in self.crossings],
            "crossing_directions": [crossing.direction for crossing in self.crossings],
            "phase_margin": margin and margin.phase_margin,
            "delay_margin": margin and margin.delay,
            "stable_delays": [list(interval) for interval in self.stable_delays],
            "stable": self.is_stable,
            "stable_gains": [
                [x if math.isfinite(x) else None for x in window]
                for window in self.stable_gains
            ],
            "rightmost_root": _Parts(self.rightmost_root),
            "unresolved_below": self.unresolved,
            "slave_root": _Parts(self.slave_root),
            "hidden_modes": [_Parts(mode) for mode in self.hidden_modes.tolist()],
            "neutral_roots": self.num_neutral,
            "loop_order": self.loop.num_states,
            "by_differences": list(self.model.by_differences),
            "force_mode": self.force_mode and self.force_mode.ToRecord(),
        }


def _Parts(root: complex | None) -> list[float] | None:
    """Returns real and imaginary part of a root, if any."""
    return None if root is None else [root.real, root.imag]


def AnalyzeModel(
    model: LoopModel, *, delay: float, max_delay: float = MAX_DELAY
) -> PointStability:
    """Analyses the loop at an operating point.

    Args:
        model: The linear model of the loop.
        delay: Round-trip delay of the scenario in s.
        max_delay: The largest round-trip delay of the intervals, in s, > 0.
    """
    cut = CutLoop(model)
    loop, hidden = minimal_realization(cut)
    # A root slower than the motion, or 0 to rounding, cannot be distinguished from 0.
    fastest = float(np.abs(np.linalg.eigvals(cut.A)).max(initial=0.0))
    motion_rate = model.motion.Rate(cut) if model.motion else 0.0
    unresolved = max(motion_rate, _NEUTRAL * fastest)
    is_neutral = np.abs(hidden) < unresolved
    hidden_modes = rightmost(hidden[~is_neutral])
    crossings = _ResolvedCrossings(model, loop, max_delay, unresolved)
    # Hidden modes do not depend on the delay. If one of them does not decay, the loop
    # is unstable at every delay.
    intervals: list[Interval] = []
    margin = None
    if _AllDecay(hidden_modes):
        intervals = stable_delays(loop, max_delay, crossings, unresolved)
        margin = delay_margin(loop, crossings, unresolved)
    without_delay = np.linalg.eigvals(closed_loop_matrix(loop))
    num_slow = int(np.sum(np.abs(without_delay) < unresolved))
    slave_roots = np.linalg.eigvals(model.slave.A).astype(complex)
    slave_roots = rightmost(slave_roots[np.abs(slave_roots) >= unresolved])
    return PointStability(
        model=model,
        loop=loop,
        delay=delay,
        max_delay=max_delay,
        crossings=crossings,
        margin=margin,
        stable_delays=intervals,
        hidden_modes=hidden_modes,
        num_neutral=int(is_neutral.sum()) + max(num_slow, neutral_root_count(loop)),
        unresolved=unresolved,
        slave_root=complex(slave_roots[0]) if len(slave_roots) else None,
    )


def _ResolvedCrossings(
    model: LoopModel, loop: StateSpace, max_delay: float, unresolved: float
) -> list[Crossing]:
    """Returns the crossings of the loop whose roots are faster than the motion."""
    crossings = find_crossings(loop)
    motion = model.motion
    if motion is None:
        return crossings
    if not _HasDivergence(loop, max_delay, unresolved):
        # A root that passes through 0 stays in the circle of unresolved roots.
        crossings = [x for x in crossings if x.frequency > 0]
    return [x for x in crossings if _IsResolved(motion, x, unresolved)]


def _AllDecay(modes: ComplexArray) -> bool:
    """Returns whether all modes lie left of the imaginary axis."""
    return bool(np.all(modes.real < -_ON_AXIS * np.abs(modes)))


def _HasDivergence(loop: StateSpace, delay: float, unresolved: float) -> bool:
    """Returns whether a resolved real root lies right of the imaginary axis."""
    roots = characteristic_roots(loop.fed_back(delay), count=loop.num_states)
    return bool(np.any((roots.imag == 0) & (roots.real > unresolved)))


def _IsResolved(motion: Motion, crossing: Crossing, unresolved: float) -> bool:
    """Returns whether the roots that cross are faster than the motion.

    Roots are resolved if they move by less than their magnitude in the time
    1/|s| + T, in which the mode turns by a radian and its signals cross the delay T.
    """
    s = 1j * crossing.frequency
    if s == 0:
        return True
    # Newton's steps from s to the roots of the loops on both sides of the point.
    behind, ahead = (
        loop.fed_back(crossing.delay).newton_step(s)
        for loop in (motion.behind, motion.ahead)
    )
    speed = abs(ahead - behind) / motion.time
    duration = 1 / abs(s) + crossing.delay
    return abs(s) > unresolved and speed * duration < abs(s)
