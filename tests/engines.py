"""One scenario by both engines, compared where both end a step."""

import numpy as np
from pydrake.systems.analysis import SimulatorConfig

from teleop_drake.compiler.engine import CompiledRun
from teleop_drake.compiler.evaluator import Evaluator
from teleop_drake.scenario import AnyScenario
from teleop_drake.signals import NamedSignals
from teleop_drake.simulation import MakeDiagram, MakeSimulator
from teleop_drake.simulation.compiled_run import SignalPlaces
from teleop_drake.simulation.simulator import EVENT_ACCURACY

Signals = dict[str, np.ndarray]


def InDrake(scenario: AnyScenario, times: np.ndarray) -> Signals:
    """Returns the signals (k, n) at times in s, by Drake's Simulator."""
    diagram = MakeDiagram(scenario)
    simulator = MakeSimulator(diagram, scenario.simulator)
    root, rows = simulator.get_context(), []
    for time in times:
        simulator.AdvanceTo(time)
        rows.append(
            {
                name: np.array(port.Eval(port.get_system().GetMyContextFromRoot(root)))
                for name, port in NamedSignals(diagram.GetSystems()).items()
            }
        )
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def Compiled(
    scenario: AnyScenario, times: np.ndarray, *, as_machine_code: bool = False
) -> Signals:
    """Returns the signals (k, n) at times in s, by the compiled engine."""
    diagram = MakeDiagram(scenario)
    context = diagram.CreateDefaultContext()
    context.SetAccuracy(EVENT_ACCURACY)
    diagram.ExecuteInitializationEvents(context)
    config: SimulatorConfig = scenario.simulator
    run = CompiledRun(
        Evaluator(diagram, context, as_machine_code=as_machine_code),
        context,
        end=scenario.duration,
        accuracy=config.accuracy,
        max_step=config.max_step_size,
    )
    rows = []
    for time in times:
        while run.time < time:
            piece = run.Advance(time)[1]
            assert not run.failure
        rows.append(piece[-1])
    places = SignalPlaces(run.evaluator, diagram)
    return {name: np.array(rows)[:, place] for name, place in places.items()}


def Errors(one: Signals, other: Signals) -> dict[str, float]:
    """Returns by how much signals differ, as shares of their ranges in `other`."""
    return {
        name: float(
            np.abs(one[name] - other[name]).max()
            / max(np.ptp(other[name], axis=0).max(initial=0.0), 1e-12)
        )
        for name in other
        if other[name].size
    }
