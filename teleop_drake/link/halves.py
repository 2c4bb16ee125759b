"""A side of the teleoperator as a compiled run that goes on period by period."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from teleop_drake.compiler.check import CheckVisited
from teleop_drake.compiler.engine import CompiledRun
from teleop_drake.compiler.evaluator import Evaluator
from teleop_drake.compiler.flatten import OutputOf
from teleop_drake.integrator.problem import EVALUATIONS, SAME, STEPS
from teleop_drake.scenario import Scenario
from teleop_drake.signals import NamedSignals
from teleop_drake.simulation.simulator import EVENT_ACCURACY
from teleop_drake.simulation.stepping import LongestStep
from teleop_drake.simulation.structure import WhyNotSolved
from teleop_drake.teleoperator import AddTeleoperator
from teleop_drake.validation import ScenarioError

Array = NDArray[np.float64]

WAYS = {"operator": ("return", "forward"), "robot": ("forward", "return")}
"""The directions in which a side hears and speaks."""


class Half:
    """A side that is simulated: called with a time and a packet, it returns its own.

    Args:
        scenario: Of the whole loop.
        side: One of WAYS.
        own: Systems of one's own, as MakeTeleoperator() takes them.

    Attributes:
        initial: The first packet of each direction, by its name.

    Raises:
        UnsupportedSystem: If a system cannot be compiled; it is named.
    """

    def __init__(self, scenario: Scenario, side: str, own: Mapping[str, Any]):
        if why := WhyNotSolved(scenario.simulator):
            raise ScenarioError(f"simulator: {why}")
        heard, spoken = WAYS[side]
        builder = DiagramBuilder()
        architecture = AddTeleoperator(builder, scenario, side=side, **own)
        self.initial = {
            way: np.array(getattr(architecture, f"initial_{way}_packet"), float)
            for way in WAYS[side]
        }
        channel = builder.GetSubsystemByName(f"{heard}_channel")
        builder.ExportInput(channel.get_input_port(), "packet")
        diagram = builder.Build()
        context = diagram.CreateDefaultContext()
        context.SetAccuracy(EVENT_ACCURACY)
        diagram.get_input_port(0).FixValue(context, self.initial[heard])
        diagram.ExecuteInitializationEvents(context)
        evaluator = Evaluator(diagram, context, as_machine_code=True)
        config = scenario.simulator
        self._run = CompiledRun(
            evaluator,
            context,
            end=scenario.duration,
            accuracy=config.accuracy,
            max_step=min(config.max_step_size, LongestStep(diagram, of_delays=False)),
        )
        CheckVisited(evaluator, diagram, context, [self._run.start])
        program, blocks = evaluator.program, evaluator.blocks
        inputs = {blocks[i].system: place for (i, _), place in program.fed.items()}
        self._fed, self._rows = inputs[channel], list[Array]()
        self._places = {
            name: program.signals[OutputOf(blocks, port.get_system(), port.get_index())]
            for name, port in NamedSignals(diagram.GetSystems()).items()
        }
        self._sent = self._places[f"{spoken}_packet_sent"]

    def __call__(self, t: float, packet: Array) -> Array:
        """Simulates until t in s with the packet before; returns what is sent then."""
        run, row = self._run, None
        while row is None or run.time < t - SAME:
            _, rows, _ = run.Advance(t)
            run.Forget()
            if run.failure or run.error is not None:
                raise ArithmeticError(run.failure or run.error)
            if len(rows):  # At the start, before what happens there.
                row = rows[-1 if t else 0].copy()
        run.Feed(self._fed, packet)
        self._rows.append(row)
        return row[self._sent]

    def Counts(self) -> tuple[int, int]:
        """Returns how many steps were taken, and how often rates were evaluated."""
        counts = self._run.memory.counts
        return int(counts[STEPS]), int(counts[EVALUATIONS])

    def Signals(self) -> dict[str, Array]:
        """Returns the signals (N, k) at the N calls, by name."""
        rows = np.array(self._rows)
        return {name: rows[:, place] for name, place in self._places.items()}
