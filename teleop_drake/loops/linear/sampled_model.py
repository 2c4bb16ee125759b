"""The loop of a diagram with holds, samplers and sampled laws, at one of its ports."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, System

from teleop_drake.loops.framework.arrays import Array, ComplexArray
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.kernel.linear_part import Sampling
from teleop_drake.loops.linear.cut_diagram import Cut
from teleop_drake.loops.linear.port_model import BodeDiagram, ImportControl
from teleop_drake.loops.linear.states import HeldStates, States
from teleop_drake.loops.numerics.margins import Margins
from teleop_drake.loops.numerics.sample_schedule import Clock, common_period
from teleop_drake.loops.numerics.sampled_loop import SampledLoop, lift
from teleop_drake.loops.numerics.sampled_margins import sampled_margins

# The frequencies of a Bode diagram, from this share of the Nyquist frequency up to it.
_NUM_FREQUENCIES = 400
_LOWEST_SHARE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SampledModel:
    """The loop transfer function L of a sampled loop at a port, with exact delays.

    It has the sign of negative feedback, as PortModel: the loop is closed by u = -y.

    Attributes:
        loop: The loop from u to the signal that comes back, which is -y.
        by_differences: As in PortModel.
        held: As in PortModel.
    """

    loop: SampledLoop
    by_differences: tuple[str, ...]
    held: tuple[str, ...]

    def __repr__(self) -> str:
        """Returns sizes, periods and delays on one line."""
        periods = sorted({clock.period for clock in self.loop.clocks})
        shown = ", ".join(f"{period:g}" for period in periods)
        delays = ", ".join(f"{delay:g}" for delay in sorted(set(self.loop.delays)))
        return (
            f"SampledModel({self.loop.num_ports} signals, {self.loop.num_states} "
            f"states, {self.loop.num_held} sampled with periods [{shown}] s, "
            f"delays [{delays}] s)"
        )

    def Roots(self) -> ComplexArray:
        """Returns the characteristic roots z of the closed loop over `period`.

        The loop is stable if all of them have a magnitude below 1.
        """
        return self.loop.closed().roots()

    @property
    def period(self) -> float:
        """The common period of all updates in s."""
        return common_period(self.loop.clocks)

    def margins(self, *, remedies: bool = True) -> Margins:
        """Returns the margins of the loop, for all signals of the port alike.

        The additional delay is a continuous one. It is searched up to 40 of the
        shortest period; infinity: there is no limit up to there.

        Args:
            remedies: As in PortModel.margins().

        Raises:
            ContinuousDelayLoop: If a delay is in a loop without a hold.
            ScenarioError: If the periods are not commensurate.
        """
        return sampled_margins(self.loop, remedies=remedies)

    def Response(self, frequencies: ArrayLike) -> ComplexArray:
        """Returns L(exp(j w h)) with the sample period h (M, p, p).

        Args:
            frequencies: w in rad/s, at most pi/h (M,).

        Raises:
            ScenarioError: If the port is not the input of holds or samplers that all
                have the only period, or a frequency is higher.
        """
        sampled = self._Sampled()
        w = np.asarray(frequencies, float).reshape(-1)
        highest = math.pi / self.period
        if w.max(initial=0.0) > highest * (1 + 1e-12):
            allowed = f"at most the Nyquist frequency, {highest:.6g} (rad/s)"
            Refuse("frequencies", w.max(), allowed)
        return -lift(self.loop, sampled).response(w * self.period)

    def bode(self, frequencies: ArrayLike | None = None) -> BodeDiagram:
        """Returns magnitude and phase of L up to the Nyquist frequency.

        Args:
            frequencies: As for Response(), ascending. By default they cover three
                decades below the Nyquist frequency.
        """
        if frequencies is None:
            shares = np.geomspace(_LOWEST_SHARE, 1.0, _NUM_FREQUENCIES)
            frequencies = shares * math.pi / self.period
        response = self.Response(frequencies)
        # The phase turns by less than half a turn from one frequency to the next.
        phase = np.unwrap(np.angle(response), axis=0)
        return BodeDiagram.Of(np.asarray(frequencies), np.abs(response), phase)

    def to_control(self) -> Any:
        """Returns L as a discrete control.StateSpace of python-control, exactly.

        Raises:
            ModuleNotFoundError: If python-control is not installed.
            ScenarioError: As for Response().
        """
        control = ImportControl()
        lifted = lift(self.loop, self._Sampled())
        return control.ss(lifted.A, lifted.B, -lifted.C, -lifted.D, lifted.period)

    def _Sampled(self) -> list[int]:
        """Returns the discrete states whose updates the port's signal enters."""
        loop = self.loop
        inputs = loop.matrix[:, len(loop.matrix) - loop.num_ports :] != 0
        updates = np.arange(loop.num_states, loop.num_inner)
        entered = np.flatnonzero(inputs.any(axis=1))
        clocks = set(loop.clocks)
        if not np.isin(entered, updates).all() or len(clocks) > 1:
            allowed = (
                "the input of a hold or a sampler, in a diagram with one sample "
                "period; margins() serves at any port"
            )
            Refuse("port", repr(self), allowed)
        return (entered - loop.num_states).tolist()


def HeldIn(system: System, context: Context) -> HeldStates | None:
    """Returns the discrete states of a block that has one periodic update, or None."""
    if context.num_abstract_states() or isinstance(system, MultibodyPlant):
        return None
    timing = system.GetUniquePeriodicDiscreteUpdateAttribute()
    if timing is None:
        return None
    groups = range(context.num_discrete_state_groups())
    size = sum(context.get_discrete_state(i).size() for i in groups)
    clock = Clock(timing.period_sec(), timing.offset_sec())
    return HeldStates(system, context, size, clock)


def MakeSampledLoop(
    slopes: Array,
    states: Sequence[States],
    held: Sequence[HeldStates],
    delays: Sequence[Cut],
    samplers: Sequence[tuple[Cut, Sampling]],
) -> SampledLoop:
    """Returns the sampled loop of the slopes of a cut diagram.

    A sampler with a delay is a discrete state, whose update is the signal that enters,
    followed by an exact delay.

    Args:
        slopes: The slopes with the rows [dx/dt; q+; y; e; signals into samplers] and
            the columns [x; q; u; d; signals out of samplers].
        states: The continuous states x.
        held: The discrete states q.
        delays: The exact delays from e to d.
        samplers: The samplers.
    """
    n = sum(x.size for x in states)
    m = sum(x.size for x in held)
    sizes = [len(cut.value) for cut, _ in samplers]
    num_sampled = sum(sizes)
    num_delayed = sum(len(cut.value) for cut in delays)
    num_ports = len(slopes) - n - m - num_delayed - num_sampled
    # The places in slopes, which are those of the rows and of the columns.
    inner = np.arange(n + m)
    port = n + m + np.arange(num_ports)
    delayed = n + m + num_ports + np.arange(num_delayed)
    sampled = n + m + num_ports + num_delayed + np.arange(num_sampled)
    # Their places in the matrix of the loop: the new states follow q.
    new = n + m + np.arange(num_sampled)
    kept = n + m + num_sampled + np.arange(num_delayed)
    lagged = n + m + num_sampled + num_delayed + np.arange(num_sampled)
    size = len(slopes) + num_sampled
    last = size - num_ports + np.arange(num_ports)
    rows = np.concatenate([inner, new, kept, last])
    columns = np.concatenate([inner, kept, lagged, last])
    from_rows = np.concatenate([inner, sampled, delayed, port])
    from_columns = np.concatenate([inner, delayed, sampled, port])
    matrix = np.zeros((size, size))
    matrix[np.ix_(rows, columns)] = slopes[np.ix_(from_rows, from_columns)]
    matrix[lagged, new] = 1.0
    clocks = [x.clock for x in held for _ in range(x.size)]
    times = [cut.time for cut in delays for _ in cut.value]
    for (_, sampling), count in zip(samplers, sizes, strict=True):
        clocks += [Clock(sampling.period)] * count
        times += [sampling.delay] * count
    return SampledLoop(
        matrix=matrix, num_states=n, clocks=tuple(clocks), delays=tuple(times)
    )
