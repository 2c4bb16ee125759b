"""Comparison of the events that a block has in Drake with those of its kernel.

A compiled run executes the events of kernels and no others. A block that has more, for
instance because a subclass declares a periodic update, is therefore refused.

Drake reports the witness functions of a block but neither its periodic nor its per-step
events. They are found in two ways:

* A KernelBlock notes each event that is declared besides those of its kernel.
* Any other block is run on its own in Drake's Simulator, from event to event. The
  handlers of its events are the Python functions that the Simulator calls. The events
  of Drake's own primitives have no such handler. The run ends after 1000 steps, so an
  event that happens for the first time after 1000 others is not found.

Initialization events need no comparison: they are executed before a compiled run. The
handlers see a Context of their own, and are executed as in any run of Drake's.
"""

import contextlib
import gc
import sys
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

from teleop_drake.engine.flatten import UnsupportedSystem
from teleop_drake.kernel import Kernel, KernelBlock
from teleop_drake.kernel.events import Ticks

# How far the run of a block goes, s: no period and no offset is longer in practice.
_HORIZON = 1e9

# The run of a block ends after so many steps, each of which ends at an event.
_MAX_STEPS = 1000


def CheckEvents(system: System, kernel: Kernel, context: Context) -> None:
    """Checks that a kernel has all events of its block.

    Args:
        context: Of the block.

    Raises:
        UnsupportedSystem: If the block has events that the kernel does not have, or if
            they cannot be determined.
    """
    accurate = system.CreateDefaultContext()
    accurate.SetAccuracy(1e-4)  # Where events are located.
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
    calls: dict[float, list[str]] = {}
    try:
        _Run(system, _OwnContext(system, context), calls)
    except Exception as error:
        if not calls:
            reason = f"its events cannot be determined: {error}"
            raise UnsupportedSystem(system, reason) from error
    # The kernel of one of Drake's own has no function of Python behind its events.
    known = kernel.transitions.values() if hasattr(system, "Kernel") else ()
    periodic = [Ticks(x.period, x.offset) for x in known if x.guard is None]
    for time, handlers in calls.items():
        if len(handlers) > sum(ticks.At(time) is not None for ticks in periodic):
            reason = f"its kernel does not know the event {handlers[-1]}()"
            raise UnsupportedSystem(system, reason)


def _OwnContext(system: System, context: Context) -> Context:
    """Returns a Context of a block on its own, with the inputs that another one has."""
    own = system.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        if port.get_data_type() == PortDataType.kVectorValued:
            port.FixValue(own, np.zeros(port.size()))
    # An input may depend on a port that is not connected.
    with contextlib.suppress(Exception):
        system.FixInputPortsFrom(system, context, own)
    return own


def _Run(system: System, context: Context, calls: dict[float, list[str]]) -> None:
    """Runs a block in Drake's Simulator from event to event.

    Args:
        calls: Gets the names of the Python functions that handle events, by the time in
            s of the call.
    """
    simulator = Simulator(system, context)
    config = SimulatorConfig(
        integration_scheme="explicit_euler",
        max_step_size=_HORIZON,
        use_error_control=False,
    )
    ApplySimulatorConfig(config, simulator)

    def EndAfterSomeSteps(_: Context) -> EventStatus:
        if simulator.get_num_steps_taken() >= _MAX_STEPS:
            return EventStatus.ReachedTermination(system, "enough events")
        return EventStatus.DidNothing()

    parameters = InitializeParams(suppress_initialization_events=True)
    caller: FrameType | None = sys._getframe()

    def NoteCall(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        # What Drake calls has this function for its caller.
        is_called_by_drake = event == "call" and frame.f_back is caller
        if not is_called_by_drake or code is EndAfterSomeSteps.__code__:
            return
        if code.co_name != "DoCalcTimeDerivatives":
            calls.setdefault(context.get_time(), []).append(code.co_name)

    simulator.set_monitor(EndAfterSomeSteps)
    profiler: Any = sys.getprofile()  # A function, or an object such as cProfile's.
    # Callbacks of the garbage collector would look like handlers of events.
    has_collector = gc.isenabled()
    gc.disable()
    sys.setprofile(NoteCall)
    try:
        simulator.Initialize(parameters)
        simulator.AdvanceTo(context.get_time() + _HORIZON)
        simulator.AdvancePendingEvents()
    finally:
        sys.setprofile(None)
        if hasattr(profiler, "enable"):
            profiler.enable()
        else:
            sys.setprofile(profiler)
        if has_collector:
            gc.enable()
        simulator.clear_monitor()
        caller = None  # This frame refers to itself, and so keeps the block.
