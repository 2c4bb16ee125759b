"""Comparison of a block's events in Drake with the events of its kernel.

A compiled run executes only the events of kernels. A block that has further events, for
example because a subclass declares a periodic update, is therefore refused.

Drake reports the witness functions of a block but neither its periodic nor its per-step
events. They are found in two ways:

* A KernelBlock records each declaration of an event that its kernel does not have.
* Any other block is run by itself in Drake's Simulator, from event to event. The
  handlers of its events are the Python functions that the Simulator calls. The events
  of Drake's own primitives have no such handler. The run ends after 1000 steps, so an
  event that happens for the first time after 1000 others is not found.

Initialization events need no comparison: they are executed before a compiled run. The
trial run of a block has a Context of its own, but it does execute the block's handlers.
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

# The length of a block's trial run, s; in practice, periods and offsets are shorter.
_HORIZON = 1e9

# The most steps of a block's trial run; each step ends at an event.
_MAX_STEPS = 1000


def CheckEvents(system: System, kernel: Kernel, context: Context) -> None:
    """Checks that a kernel has all events of its block.

    Args:
        system: The block.
        kernel: The block's kernel.
        context: The block's Context.

    Raises:
        UnsupportedSystem: If the block has events that the kernel does not have, or if
            they cannot be determined.
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
    calls: dict[float, list[str]] = {}
    try:
        _Run(system, _OwnContext(system, context), calls)
    except Exception as error:
        if not calls:
            reason = f"its events cannot be determined: {error}"
            raise UnsupportedSystem(system, reason) from error
    # The events of Drake's own primitives call no Python function, and add no handler.
    known = kernel.transitions.values() if hasattr(system, "Kernel") else ()
    periodic = [Ticks(x.period, x.offset) for x in known if x.guard is None]
    # Each instant may have as many handlers as periodic transitions are due then.
    for time, handlers in calls.items():
        if len(handlers) > sum(ticks.At(time) is not None for ticks in periodic):
            reason = f"its kernel does not know the event {handlers[-1]}()"
            raise UnsupportedSystem(system, reason)


def _OwnContext(system: System, context: Context) -> Context:
    """Returns a Context of a block outside of its diagram.

    Args:
        context: The block's Context in the diagram. The time, the state, the parameters
            and the inputs are copied; inputs without a value are 0.
    """
    own = system.CreateDefaultContext()
    own.SetTimeStateAndParametersFrom(context)
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        if port.get_data_type() == PortDataType.kVectorValued:
            port.FixValue(own, np.zeros(port.size()))
    # It raises an error if an input depends on a port that is not connected.
    with contextlib.suppress(Exception):
        system.FixInputPortsFrom(system, context, own)
    return own


def _Run(system: System, context: Context, calls: dict[float, list[str]]) -> None:
    """Runs a block in Drake's Simulator from event to event.

    Args:
        calls: A dictionary to which the names of the Python functions that handle
            events are added, keyed by the time of the call in s.
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
        # Drake has no frame in Python, so the caller of its callbacks is this function.
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
        caller = None  # A frame that refers to itself would keep the block alive.
