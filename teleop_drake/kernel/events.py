"""Drake's events, made from the transitions of a kernel."""

import math
import warnings
import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from pydrake.systems.framework import (
    Context,
    DiscreteValues,
    Event,
    EventStatus,
    LeafSystem,
    State,
    UnrestrictedUpdateEvent,
    WitnessFunction,
    WitnessFunctionDirection,
)

from teleop_drake.kernel.callbacks import Weakly
from teleop_drake.kernel.kernel import Kernel, Term, Transition
from teleop_drake.kernel.ticks import DeclareTicks, Ticks

Value = Callable[[Context], Any]
ReadTerm = Callable[[Term, str], Value]


class Events:
    """The Drake events of a block, made from its kernel's transitions.

    The block has to hold this object: Drake's callbacks refer to it weakly.

    | in a transition      | in Drake                                                |
    |----------------------|---------------------------------------------------------|
    | guard                | a witness, where the Context has an accuracy, and a     |
    |                      | discrete update at the end of each step where the guard |
    |                      | has jumped                                              |
    | period               | an update at each tick, see ticks                       |
    | mode that stays      | steps that end there                                    |

    Attributes:
        ticks: The instants of periodic unrestricted updates.
        discrete_ticks: The instants of periodic discrete updates.

    Args:
        block: The block, which has declared its inputs and its state.
        read: Returns a function of a Context for a term at a place in the kernel.
    """

    def __init__(self, block: LeafSystem, kernel: Kernel, read: ReadTerm):
        self.ticks: list[Ticks] = []
        self.discrete_ticks: list[Ticks] = []
        self._guards: list[tuple[Value, Value]] = []
        self._block = weakref.ref(block)
        self._has_warned = False
        self._kept: list[Callable[..., Any]] = []
        self._witnesses: list[WitnessFunction] = []
        for name, transition in kernel.transitions.items():
            place = f"transitions.{name}"
            mode = read(transition.mode, f"{place}.mode")
            if transition.guard is None:
                self._DeclarePeriodic(block, transition, mode)
            else:
                guard = read(transition.guard, f"{place}.guard")
                self._DeclareGuard(block, name, guard, mode)
        if self._guards:
            block.DeclarePerStepDiscreteUpdateEvent(Weakly(self._CheckGuards))
        if kernel.initial_mode is not None:
            initial = read(kernel.initial_mode, "initial_mode")

            def Initialize(context: Context, state: State) -> None:
                state.get_mutable_discrete_state(0).SetFromVector(initial(context))

            block.DeclareInitializationUnrestrictedUpdateEvent(self._Keep(Initialize))

    @property
    def has_guards(self) -> bool:
        """Whether a transition has a guard."""
        return bool(self._guards)

    def Guards(self, context: Context) -> list[float]:
        """Returns the values of the guards."""
        return [float(guard(context)[0]) for guard, _ in self._guards]

    def Witnesses(self, context: Context) -> list[WitnessFunction]:
        """Returns the witnesses, if events are to be located."""
        return self._witnesses if context.get_accuracy() is not None else []

    def _Keep(self, function: Callable[..., Any]) -> Callable[..., Any]:
        self._kept.append(function)
        return Weakly(function)

    def _DeclarePeriodic(
        self, block: LeafSystem, transition: Transition, mode: Value
    ) -> None:
        """Declares a periodic transition; a mode that stays only ends steps."""
        ticks = Ticks(transition.period, transition.offset)
        if transition.mode == "mode":
            DeclareTicks(block, ticks, None)
            return
        change = partial(_Change, mode)
        weak_change = self._Keep(change)
        if transition.is_discrete:
            self.discrete_ticks.append(ticks)
            block.DeclarePeriodicDiscreteUpdateEvent(
                ticks.period, ticks.offset, weak_change
            )
            return
        DeclareTicks(block, ticks, change)
        if ticks.period < math.inf:
            self.ticks.append(ticks)

    def _DeclareGuard(
        self, block: LeafSystem, name: str, guard: Value, mode: Value
    ) -> None:
        """Adds a transition's guard to the guards and to the witness functions."""

        def Calc(context: Context) -> float:
            return float(guard(context)[0])

        def Update(context: Context, event: Event, state: State) -> None:
            _Change(mode, context, state)

        self._guards.append((guard, mode))
        self._witnesses.append(
            block.MakeWitnessFunction(
                name,
                WitnessFunctionDirection.kNegativeThenNonNegative,
                self._Keep(Calc),
                UnrestrictedUpdateEvent(self._Keep(Update)),
            )
        )

    def _CheckGuards(self, context: Context, values: DiscreteValues) -> EventStatus:
        if context.get_accuracy() is None and not self._has_warned:
            self._has_warned = True
            self._WarnOfAccuracy()
        due = [mode for guard, mode in self._guards if guard(context)[0] >= 0]
        for mode in due:
            _Change(mode, context, values)
        return EventStatus.Succeeded() if due else EventStatus.DidNothing()

    def _WarnOfAccuracy(self) -> None:
        """Warns that a Simulator steps across the events of the block."""
        block = self._block()
        name = "" if block is None else block.GetSystemPathname().removeprefix("::")
        warnings.warn(
            f"{name}: no event is located, because the Context has no accuracy, and "
            "the run is off by some per cent after a contact. Call "
            "simulator.get_mutable_context().SetAccuracy(1e-4) before the run, or use "
            "the Simulator of teleop_drake.MakeSimulator(diagram, config), which also "
            "limits the steps.",
            stacklevel=2,
        )


def _Change(mode: Value, context: Context, target: State | DiscreteValues) -> None:
    """Sets the elements of the mode in which the new mode differs from the old one."""
    if isinstance(target, State):
        target = target.get_mutable_discrete_state()
    values = target.get_mutable_vector(0)
    before = context.get_discrete_state_vector().value()
    after = mode(context)
    for i in np.flatnonzero(after != before).tolist():
        values.SetAtIndex(i, after[i])
