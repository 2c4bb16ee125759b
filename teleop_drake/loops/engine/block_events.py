"""Comparison of a block's events in Drake with the events of its kernel.

A compiled run executes only the events of kernels. A block that has further events, for
example because a subclass declares a periodic update, is therefore refused. So is a
block that a compiled run leaves out, such as a log, to which a user has added an event.

Drake reports the witness functions of a block but neither its periodic nor its per-step
events. They are found in two ways:

* A KernelBlock records each declaration of an event that its kernel does not have.
* Any other block is run by itself in Drake's Simulator, from event to event; see
  _Trial. The handlers of its events are the Python functions that the Simulator calls.
  The events of Drake's own systems have no such handler.

Initialization events need no comparison: they are executed before a compiled run.
"""

import contextlib
import gc
import math
import sys
from collections.abc import Sequence
from types import FrameType
from typing import Any

import numpy as np
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    InitializeParams,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import (
    Context,
    EventStatus,
    PortDataType,
    System,
)

from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.framework.wiring import InputPorts
from teleop_drake.loops.kernel import Kernel, KernelBlock
from teleop_drake.loops.kernel.events import Ticks
from teleop_drake.loops.numerics.instants import same_within

# The length of a block's trial run, s; in practice, periods and offsets are shorter.
_HORIZON = 1e9

# The most events of a block's trial run. An event that happens for the first time after
# so many others is not found.
_MAX_EVENTS = 1000

# At so many instants of a trial run, handlers of events that the kernel has are called.
_NUM_EXECUTED = 10

# Methods of a LeafSystem that Drake's Simulator calls, and that handle no event.
_NO_HANDLERS = ("DoCalcTimeDerivatives", "DoGetWitnessFunctions")


def CheckEvents(
    system: System, kernel: Kernel, context: Context, *, is_sink: bool = False
) -> None:
    """Checks that a kernel has all events of its block, and no others.

    Args:
        system: The block.
        kernel: The block's kernel.
        context: The block's Context.
        is_sink: Whether a compiled run leaves out the block, see IsSink().

    Raises:
        UnsupportedSystem: If the block has events that the kernel does not have, or
            lacks one at the time of a transition, or if its events cannot be
            determined.
    """
    accurate = system.CreateDefaultContext()
    accurate.SetAccuracy(1e-4)  # Else a KernelBlock reports no witness functions.
    witnesses = system.GetWitnessFunctions(accurate)
    if isinstance(system, KernelBlock):
        guards = [x for x in kernel.transitions.values() if x.guard is not None]
        unknown = [f"{name}()" for name in system.other_events]
        if len(witnesses) > len(guards):
            unknown.append("witness function")
        if unknown:
            reason = f"its kernel does not know its {unknown[0]}"
            raise UnsupportedSystem(system, reason)
        return
    if witnesses:
        reason = "its witness functions are not made of its kernel, as a KernelBlock's"
        raise UnsupportedSystem(system, reason)
    # The transitions of Drake's own primitives have no handlers in Python.
    has_handlers = hasattr(system, "Kernel")
    known = kernel.transitions.values() if has_handlers else ()
    ticks = [Ticks(x.period, x.offset) for x in known if x.guard is None]
    trial = _Trial(system, OwnContext(system, context, is_sink=is_sink), ticks)
    try:
        trial.Run()
    except Exception as error:
        # A visualizer fails without its input.
        if not (is_sink or trial.calls):
            reason = f"its events cannot be determined: {error}"
            raise UnsupportedSystem(system, reason) from error
    if trial.unknown:
        reason = f"its kernel does not know the event {trial.unknown}()"
        raise UnsupportedSystem(system, reason)
    for each in ticks:
        time = trial.Missing(each)
        if time is not None:
            reason = f"its kernel has an event at {time:g} s, which the block has not"
            raise UnsupportedSystem(system, reason)


def OwnContext(system: System, context: Context, *, is_sink: bool = False) -> Context:
    """Returns a Context of a block outside of its diagram.

    Args:
        context: The block's Context in the diagram. The time, the state, the parameters
            and the inputs are copied; inputs without a value are 0.
        is_sink: Whether inputs are not copied, so that a visualizer draws nothing.
    """
    own = system.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    for port in InputPorts(system):
        if port.get_data_type() == PortDataType.kVectorValued:
            port.FixValue(own, np.zeros(port.size()))
    if not is_sink:
        # It raises an error if an input depends on a port that is not connected.
        with contextlib.suppress(Exception):
            system.FixInputPortsFrom(system, context, own)
    return own


class _Stop(Exception):
    """Raised in the place of a handler, of which no line is executed then."""


class _Trial:
    """A run of a block by itself in Drake's Simulator, from event to event.

    A handler of an event that the kernel does not have is not executed: the run ends
    there. Handlers at the instants of the kernel's transitions are executed at the
    first instants only, and passed over at later ones.

    Attributes:
        calls: The number of handlers called, keyed by the time in s, ascending.
        unknown: The name of a handler of an event that the kernel does not have; empty
            if there is none.

    Args:
        system: The block.
        context: A Context of the block outside of its diagram, which is changed.
        known: The instants of the kernel's transitions. At each instant there may be as
            many handlers as transitions.
    """

    def __init__(self, system: System, context: Context, known: Sequence[Ticks]):
        self.calls: dict[float, int] = {}
        self.unknown = ""
        self._known = known
        self._start = context.get_time()
        self._num_events = 0
        self._context = context
        self._simulator = Simulator(system, self._context)
        config = SimulatorConfig(
            integration_scheme="explicit_euler",
            max_step_size=_HORIZON,
            use_error_control=False,
        )
        ApplySimulatorConfig(config, self._simulator)
        self._parameters = InitializeParams(suppress_initialization_events=True)
        self._enough = EventStatus.ReachedTermination(system, "enough events")

    def Run(self) -> None:
        """Runs the block until it has no event, an unknown one, or had enough."""
        profiler: Any = sys.getprofile()  # A function, or an object such as cProfile's.
        # Callbacks of the garbage collector would look like handlers of events.
        has_collector = gc.isenabled()
        gc.disable()
        self._simulator.set_monitor(self._Count)
        try:
            while self._num_events <= _MAX_EVENTS and self._Advance():
                pass
        finally:
            self._simulator.clear_monitor()
            if hasattr(profiler, "enable"):
                profiler.enable()
            else:
                sys.setprofile(profiler)
            if has_collector:
                gc.enable()

    def Missing(self, ticks: Ticks) -> float | None:
        """Returns a time in s when no handler was called for a transition; None: none.

        Args:
            ticks: The instants of the transition. The first ones are considered.
        """
        first = ticks.After(self._start)
        expected = [first, ticks.After(first)]
        if ticks.offset >= self._start:
            expected.append(ticks.offset)
        # All handlers were called only where they were executed.
        executed = list(self.calls)[:_NUM_EXECUTED]
        for time in sorted(expected):
            if time > self._context.get_time():
                break
            found = [t for t in self.calls if abs(t - time) <= same_within(time)]
            num_due = self._NumDue(time) if found and found[0] in executed else 1
            if sum(self.calls[t] for t in found) < num_due:
                return time
        return None

    def _NumDue(self, time: float) -> int:
        """Returns the number of the kernel's transitions at a time in s."""
        return sum(ticks.At(time) is not None for ticks in self._known)

    def _Advance(self) -> bool:
        """Runs until a handler is stopped; returns whether to run on from there."""
        sys.setprofile(self._NoteCall)
        try:
            self._simulator.Initialize(self._parameters)
            self._simulator.AdvanceTo(self._start + _HORIZON)
            self._simulator.AdvancePendingEvents()
        except _Stop:
            self._num_events += 1
            # The events of this instant are passed over.
            self._context.SetTime(math.nextafter(self._context.get_time(), math.inf))
            return not self.unknown
        finally:
            sys.setprofile(None)
        return False

    def _Count(self, _: Context) -> EventStatus | None:
        """Ends the run after a number of steps, each of which ends at an event."""
        self._num_events += 1
        return self._enough if self._num_events > _MAX_EVENTS else None

    def _NoteCall(self, frame: FrameType, event: str, _: object) -> None:
        """Notes the call of a handler, and stops it unless it is to be executed."""
        code = frame.f_code
        caller = frame.f_back
        # Drake has no frame in Python, so the caller of its callbacks is _Advance().
        is_called_by_drake = (
            event == "call"
            and caller is not None
            and caller.f_code is _Trial._Advance.__code__
        )
        is_handler = code is not _Trial._Count.__code__
        if not is_called_by_drake or not is_handler or code.co_name in _NO_HANDLERS:
            return
        time = self._context.get_time()
        self.calls[time] = self.calls.get(time, 0) + 1
        is_of_drake = frame.f_globals.get("__name__", "").startswith("pydrake.")
        if self.calls[time] > self._NumDue(time) and not is_of_drake:
            self.unknown = code.co_name
        if self.unknown or is_of_drake or len(self.calls) > _NUM_EXECUTED:
            raise _Stop
