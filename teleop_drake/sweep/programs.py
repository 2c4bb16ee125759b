"""The programs of a sweep: runs that differ only in numbers share a program."""

import threading
from collections.abc import Callable, Mapping
from typing import Any

from teleop_drake.recording import Recording
from teleop_drake.scenario import AnyScenario, ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.simulation.compile import Compile, CompiledScenario
from teleop_drake.simulation.compiled_run import CannotCompile
from teleop_drake.sweep.values import ALIASES


class Programs:
    """The programs to which the runs of one sweep have been compiled.

    Several threads may simulate with the same programs. Only one compiles at a time.
    """

    def __init__(self) -> None:
        self._programs: dict[tuple[tuple[str, str], ...], CompiledScenario] = {}
        self._compiling = threading.Lock()

    def Simulate(
        self, load: Callable[[], AnyScenario], point: Mapping[str, Any]
    ) -> Recording:
        """Simulates a run with a program of an earlier run if one fits.

        Args:
            load: Returns the scenario of the run.
            point: The values that the run has in the sweep, by the keys of the grid.

        Raises:
            ScenarioError: If the scenario is not valid.
        """
        # The names of kinds decide the structure; most other values are numbers.
        names = tuple(
            (k, value) for k, value in point.items() if isinstance(value, str)
        )
        program = self._programs.get(names)
        if program is not None:
            changes = {
                path: value
                for key, value in point.items()
                for path in ALIASES.get(key, (key,))
            }
            try:
                return program.Run(**changes)
            except ScenarioError:
                # The run needs another program, or load() raises the error below.
                pass
        scenario = load()
        try:
            with self._compiling:
                program = Compile(scenario)
        except CannotCompile:
            return simulate(scenario)
        self._programs[names] = program
        return program.Run()
