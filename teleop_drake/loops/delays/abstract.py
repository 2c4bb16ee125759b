"""A delay of values that are no vectors, such as poses and messages."""

from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from teleop_drake.loops.delays.base import MAX_PACKETS, SHORTEST_TIME, CheckDelay
from teleop_drake.loops.delays.sampled import DeclareDeliveries, ShownAfter
from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.loops.kernel import Delay
from teleop_drake.loops.kernel.events import Weakly
from teleop_drake.loops.kernel.packet_line import PacketLine


class AbstractDelay(LeafSystem):
    """Delays values of any type, which are sent in packets and held between them.

        delayed_signal(t) = signal(k h)    for k h + delay < t <= (k + 1) h + delay

    with the sample period h; see SampledDelay, which does so with vectors. Each packet
    is a copy of the value: a RigidTransform, an image, a message, an object of Python.
    Drake's DiscreteTimeDelay delays such values by whole periods; here the delay need
    not be a multiple of h.

    | port | name           | type             |
    |------|----------------|------------------|
    | in   | signal         | of initial_value |
    | out  | delayed_signal | of initial_value |

    State and treatment of jumps: those of PacketLine.

    Initial value: `initial_value` is delivered until the first packet arrives. It is
    sent at t = 0, or at the first multiple of h in a run that begins later.

    Direct feedthrough: none, not even without delay, because the signal is sampled.

    It does not interpolate. It runs in Drake's Simulator only: compiled runs and pages
    compute with numbers.

    Args:
        delay: Delay of a packet in s, >= 0.
        sample_period: h in s, > 0.
        initial_value: The output before the first packet arrives, an AbstractValue or
            the value itself. It determines the type.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(self, delay: float, sample_period: float, initial_value: Any):
        LeafSystem.__init__(self)
        CheckDelay("delay", delay)
        shortest = max(SHORTEST_TIME, delay / MAX_PACKETS)
        CheckNumber("sample_period", sample_period, "s", minimum=shortest)
        if not isinstance(initial_value, AbstractValue):
            initial_value = AbstractValue.Make(initial_value)
        self.DeclareAbstractInputPort("signal", initial_value)
        line = Delay(
            signal="signal",
            output="delayed_signal",
            initial_value=(),
            period=float(sample_period),
            shown=ShownAfter(delay, sample_period),
        )
        self._line = _ValueLine(self, line, initial_value.Clone())
        self.DeclareAbstractOutputPort(
            "delayed_signal",
            initial_value.Clone,
            Weakly(self._CalcDelayedSignal),
            self._line.tickets,
        )
        DeclareDeliveries(self, delay, sample_period)

    def NextJumpTime(self, context: Context) -> float:
        """Returns when the output jumps next, s; infinity: never."""
        return self._line.NextJumpTime(context)

    def _CalcDelayedSignal(self, context: Context, output: AbstractValue) -> None:
        output.SetFrom(self._line.Shown(context).value)


class _ValueLine(PacketLine):
    """Packets whose values are AbstractValues, which nothing changes."""

    def __init__(self, block: LeafSystem, delay: Delay, initial_value: AbstractValue):
        self._initial_value = initial_value
        self._index = block.GetInputPort(delay.signal).get_index()
        self._block = block
        PacketLine.__init__(self, block, delay, "")

    def InitialValue(self) -> AbstractValue:
        return self._initial_value

    def Take(self, context: Context) -> AbstractValue:
        value = self._block.EvalAbstractInput(context, self._index)
        if value is None:
            name = self._block.get_name()
            Refuse(f"input of {name}", "signal", "connected to a source")
        return value.Clone()
