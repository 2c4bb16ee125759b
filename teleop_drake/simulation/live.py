"""A run that somebody takes part in: it goes on step by step, and can be fed."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, System

from teleop_drake.signals import SignalsOf
from teleop_drake.simulation.run_monitor import RunMonitor

Array = NDArray[np.float64]


class LiveRun(Protocol):
    """What simulate() gives to `advance`, whatever it is run with."""

    @property
    def time(self) -> float:
        """How far the run is, s."""

    @property
    def has_ended(self) -> bool:
        """Whether it cannot go on: it diverged, or was interrupted."""

    def AdvanceTo(self, time: float) -> None:
        """Simulates until a time, or less far if the run ends before.

        Args:
            time: In s.
        """

    def Signals(self) -> dict[str, Array]:
        """Returns all signals as they are now, by name; see simulate()."""

    def Feed(self, system: System, port: str, values: ArrayLike) -> None:
        """Sets an input that is not connected; nothing may jump thereby.

        Args:
            system: The block, anywhere in the diagram.
            values: What comes in from now on.
        """


class DrakeRun:
    """A run in Drake's Simulator; see LiveRun.

    Args:
        diagram: What is run.
        simulator: Its Simulator, initialized.
        monitor: What watches it.
    """

    def __init__(self, diagram: Diagram, simulator: Simulator, monitor: RunMonitor):
        self._simulator, self._monitor = simulator, monitor
        root = simulator.get_context()
        self._signals = {
            name: (port.Eval, port.get_system().GetMyContextFromRoot(root))
            for name, port in SignalsOf(diagram).items()
        }

    @property
    def time(self) -> float:
        """How far the run is, s."""
        return float(self._simulator.get_context().get_time())

    @property
    def has_ended(self) -> bool:
        """Whether it cannot go on: it diverged, or was interrupted."""
        return bool(self._monitor.failure) or self._monitor.interruption.has_come

    def AdvanceTo(self, time: float) -> None:
        """Simulates until a time, or less far if the run ends before.

        Args:
            time: In s.
        """
        self._simulator.AdvanceTo(time)

    def Signals(self) -> dict[str, Array]:
        """Returns all signals as they are now, by name; see simulate()."""
        return {name: Eval(context) for name, (Eval, context) in self._signals.items()}

    def Feed(self, system: System, port: str, values: ArrayLike) -> None:
        """Sets an input that is not connected; nothing may jump thereby.

        Args:
            system: The block, anywhere in the diagram.
            values: What comes in from now on.
        """
        for root in (
            self._simulator.get_mutable_context(),
            self._monitor.recorder.inner_context,
        ):
            context = system.GetMyMutableContextFromRoot(root)
            system.GetInputPort(port).FixValue(context, np.asarray(values, dtype=float))
