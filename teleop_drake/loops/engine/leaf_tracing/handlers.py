"""The handlers of a Python LeafSystem's events, and the times of the events.

Drake reports neither the periodic nor the per-step events of a system. They are found
in a run of the block by itself in Drake's Simulator, which executes the rate and those
handlers that have been followed before; see EventFinder.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

import numpy as np
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    InitializeParams,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import Context, DiscreteValues, EventStatus, State

from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.engine.leaf_tracing.callbacks import (
    FindCallback,
    Found,
    FoundIn,
    IsCalledByDrake,
    IsPassed,
    Stop,
    Watched,
)
from teleop_drake.loops.engine.leaf_tracing.sinks import MayEnd
from teleop_drake.loops.jit.symbols import Untraceable
from teleop_drake.loops.numerics.instants import same_within

# The length of the run, s, and its most steps. An event that happens for the first time
# after so many others is not found.
_HORIZON = 1e9
_MAX_STEPS = 1000

# A step ends here, where no periodic event is, so that per-step events show, s.
_BESIDE = math.pi * 1e-10

# Functions that the Simulator calls, and that handle no event.
_NO_HANDLERS = ("DoCalcTimeDerivatives", "DoCalcVectorTimeDerivatives")


def HasInitialization(system: Any) -> bool:
    """Returns whether a user's block in Python has an initialization event.

    Raises:
        UnsupportedSystem: If the event may end the run.
    """
    own = system.CreateDefaultContext()
    try:
        found = FindCallback(lambda x: system.ExecuteInitializationEvents(x), own)
    except Untraceable:
        return True
    if found is not None and MayEnd(found.function.__code__):
        reason = f"its initialization event {found.name} may end a run"
        raise UnsupportedSystem(system, reason)
    return found is not None


@dataclass
class Handler:
    """The handler of a periodic event.

    Attributes:
        found: The function.
        times: The times at which the run has called it, s, ascending.
    """

    found: Found
    times: list[float] = field(default_factory=list)

    @property
    def is_discrete(self) -> bool:
        """Whether it handles a discrete update, and not an unrestricted one."""
        return not any(IsPassed(x, State) for x in self.found.arguments)

    def Check(self) -> None:
        """Refuses an event that updates no state."""
        is_update = any(
            IsPassed(x, DiscreteValues, State) for x in self.found.arguments
        )
        is_of_vectors = self.found.function.__name__.startswith("DoCalcVectorDiscrete")
        if not is_update and not is_of_vectors:
            raise Untraceable(f"its event {self.found.name} publishes")

    def Timing(self) -> tuple[float, float]:
        """Returns the period and the offset of the event, s."""
        if _BESIDE in self.times:
            raise Untraceable(f"its event {self.found.name} happens at every step")
        if len(self.times) < 2:
            raise Untraceable(f"the period of its event {self.found.name} is unknown")
        offset = self.times[0]
        period = self.times[1] - offset
        # The difference of two times is rounded; most periods have few digits.
        plain = float(f"{period:.12g}")
        if abs(plain - period) <= 4 * math.ulp(self.times[1]):
            period = plain
        for k, time in enumerate(self.times):
            if abs(offset + k * period - time) > same_within(time):
                raise Untraceable(f"its event {self.found.name} is not periodic")
        return period, offset


class EventFinder:
    """Finds the handlers of a block's events, in the order in which Drake calls them.

    Args:
        system: The block. Its rate has been followed, so that it can be executed.
        context: A Context of the block outside of its diagram, with fixed inputs.
        follow: Called with each handler before any line of it is executed; it raises
            Untraceable for a handler that cannot be followed.
    """

    def __init__(
        self, system: Any, context: Context, follow: Callable[[Handler], None]
    ):
        self._system = system
        self._start = context
        self._follow = follow
        self._handlers: dict[Any, Handler] = {}
        self._new: FrameType | None = None
        self._context = context
        self._num_steps = 0

    def Find(self) -> list[Handler]:
        """Returns the handlers.

        Raises:
            Untraceable: If a handler cannot be followed, or fails in the run.
        """
        self._Run()
        while self._new is not None:
            key = _KeyOf(self._new)
            handler = Handler(FoundIn(self._new, self._context))
            self._new = None
            handler.Check()
            self._follow(handler)
            self._handlers[key] = handler
            self._Run()
        return list(self._handlers.values())

    def _Run(self) -> None:
        """Runs the block from the time 0 until an unknown handler is called."""
        for handler in self._handlers.values():
            handler.times.clear()
        self._num_steps = 0
        self._context = self._start.Clone()
        self._context.SetTime(0.0)
        simulator = Simulator(self._system, self._context)
        config = SimulatorConfig(
            integration_scheme="explicit_euler",
            max_step_size=_HORIZON,
            use_error_control=False,
        )
        ApplySimulatorConfig(config, simulator)
        simulator.set_monitor(self._Count)
        parameters = InitializeParams(suppress_initialization_events=True)
        with np.errstate(all="ignore"), Watched(self._Note):
            try:
                self._Advance(simulator, parameters)
            except (Exception, SystemExit) as error:
                if self._new is None:
                    reason = f"its events cannot be determined: {error}"
                    raise Untraceable(reason) from error

    @staticmethod
    def _Advance(simulator: Simulator, parameters: InitializeParams) -> None:
        simulator.Initialize(parameters)
        simulator.AdvanceTo(_BESIDE)
        simulator.AdvanceTo(_HORIZON)

    def _Count(self, _: Context) -> EventStatus | None:
        """Ends the run after a number of steps; each begins at the initial state."""
        self._num_steps += 1
        if self._num_steps > _MAX_STEPS:
            return EventStatus.ReachedTermination(self._system, "enough events")
        x = self._start.get_continuous_state_vector().CopyToVector()
        if len(x) > 0:
            self._context.SetContinuousState(x)
        return None

    def _Note(self, frame: FrameType, event: str, _: Any) -> None:
        """Notes the call of a known handler; stops the run at an unknown one."""
        if not IsCalledByDrake(frame, event, EventFinder._Advance.__code__):
            return
        code = frame.f_code
        if code is EventFinder._Count.__code__ or code.co_name in _NO_HANDLERS:
            return
        handler = self._handlers.get(_KeyOf(frame))
        if handler is None:
            self._new = frame
            raise Stop
        time = self._context.get_time()
        if not handler.times or handler.times[-1] != time:
            handler.times.append(time)


def _KeyOf(frame: FrameType) -> tuple[Any, ...]:
    """Returns what the calls of one handler share: code, closure and other arguments.

    CPython does not tell the function of a frame before it has ended.
    """
    values = sorted(frame.f_locals.items())
    is_of_vectors = frame.f_code.co_name.startswith("DoCalcVector")
    others = [
        (name, id(x))
        for name, x in values
        if type(x).__module__ != "pydrake.systems.framework"
        if not (is_of_vectors and isinstance(x, np.ndarray))
    ]
    return frame.f_code, *others
