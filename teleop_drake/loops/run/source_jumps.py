"""The jumps of sources that are functions of time and announce no jump.

An example is a TrajectorySource with a piecewise constant trajectory. Without a stop at
its jumps, a delay smooths them: the samples that it stores are joined by polynomials.
"""

from collections.abc import Iterable

import numpy as np
from pydrake.systems.framework import Context, Diagram, PortDataType, System
from pydrake.systems.primitives import TrajectorySource

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.kernel import KernelBlock
from teleop_drake.loops.numerics.jumps import Jump, TooManyJumps, find_jumps

# The parts of a longest step in which jumps are searched.
_PARTS = 4


class SourceJumps:
    """Finds the next jump of some sources, ahead of a run.

    Args:
        systems: The systems of a diagram. Those are searched that have neither inputs
            nor states, and are TrajectorySources or written in Python.
        root_context: The Context of the diagram, which has their parameters.
        step: The time ahead in s, within which jumps are found.
    """

    def __init__(self, systems: Iterable[System], root_context: Context, step: float):
        self._sources = [_Source(x, root_context) for x in systems if _IsSource(x)]
        self._step = step
        self._searched = root_context.get_time()
        self._found: list[Jump] = []

    def Next(self, time: float) -> Jump | None:
        """Returns the next jump that is after a time, or begins there; None: not near.

        Args:
            time: The present time, s.
        """
        if not self._sources:
            return None
        while self._searched <= time + self._step:
            self._Search(self._searched, self._searched + self._step)
        self._found = [jump for jump in self._found if jump.after > time]
        return self._found[0] if self._found else None

    def _Search(self, begin: float, end: float) -> None:
        """Adds the jumps in an interval; leaves out a source that is mere noise."""
        found = []
        for source in list(self._sources):
            try:
                found += find_jumps(source.At, begin, end, _PARTS)
            except TooManyJumps:
                self._sources.remove(source)
        self._found += sorted(found)
        self._searched = end


class _Source:
    """A source, with a Context of its own.

    Args:
        system: The source.
        root_context: The Context of the diagram.
    """

    def __init__(self, system: System, root_context: Context):
        self._ports = [
            system.get_output_port(i)
            for i in range(system.num_output_ports())
            if system.get_output_port(i).get_data_type() == PortDataType.kVectorValued
        ]
        self._context = system.CreateDefaultContext()
        own = system.GetMyContextFromRoot(root_context)
        self._context.SetTimeStateAndParametersFrom(own)

    def At(self, time: float) -> Array:
        """Returns the values of the outputs at a time in s; NaN if there are none.

        The time may be behind the end of the run, where a user's code may fail. If the
        run itself gets there, Drake raises the error.
        """
        self._context.SetTime(time)
        try:
            return np.concatenate([port.Eval(self._context) for port in self._ports])
        except Exception:  # noqa: BLE001  # The code is a user's.
            return np.full(sum(port.size() for port in self._ports), np.nan)


def _IsSource(system: System) -> bool:
    """Returns whether a system may be a function of time that jumps unannounced."""
    is_known = isinstance(system, KernelBlock | Diagram) or hasattr(
        system, "jump_times"
    )
    if is_known or system.num_input_ports() or not system.num_output_ports():
        return False
    context = system.CreateDefaultContext()
    num_states = (
        context.num_continuous_states()
        + context.num_discrete_state_groups()
        + context.num_abstract_states()
    )
    is_python = not type(system).__module__.startswith("pydrake.")
    return num_states == 0 and (is_python or type(system) is TrajectorySource)
