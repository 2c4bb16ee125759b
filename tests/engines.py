"""One diagram by each engine, compared where all of them end a step."""

import numpy as np
from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Diagram
from wasm_runs import Instance

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.framework.signals import SignalsOf
from teleop_drake.loops.framework.solver import EVENT_ACCURACY
from teleop_drake.loops.page.model import MakeModel
from teleop_drake.loops.run.compiled_run import SignalPlaces
from teleop_drake.loops.run.simulator import MakeSimulator

Signals = dict[str, np.ndarray]


def InDrake(diagram: Diagram, config: SimulatorConfig, times: np.ndarray) -> Signals:
    """Returns the signals (k, n) at times in s, by Drake's Simulator."""
    simulator = MakeSimulator(diagram, config)
    root = simulator.get_context()
    rows = []
    for time in times:
        simulator.AdvanceTo(time)
        rows.append(
            {
                name: np.array(port.Eval(port.get_system().GetMyContextFromRoot(root)))
                for name, port in SignalsOf(diagram).items()
            }
        )
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def Compiled(
    diagram: Diagram,
    config: SimulatorConfig,
    times: np.ndarray,
    *,
    as_machine_code: bool = False,
) -> Signals:
    """Returns the signals (k, n) at times in s, by the compiled engine."""
    context = diagram.CreateDefaultContext()
    context.SetAccuracy(EVENT_ACCURACY)
    diagram.ExecuteInitializationEvents(context)
    run = CompiledRun(
        Evaluator(diagram, context, as_machine_code=as_machine_code),
        context,
        end=times[-1],
        accuracy=config.accuracy,
        max_step=config.max_step_size,
    )
    rows = []
    for time in times:
        while run.time < time:
            piece = run.Advance(time)
            assert not run.failure
        rows.append(piece[-1])
    places = SignalPlaces(run.evaluator, SignalsOf(diagram))
    return {name: np.array(rows)[:, place] for name, place in places.items()}


def InWebAssembly(
    diagram: Diagram, config: SimulatorConfig, times: np.ndarray
) -> Signals:
    """Returns the signals (k, n) at times in s, by a page's module."""
    model = MakeModel(diagram, config, times[-1])
    instance = Instance(model)
    (_, accuracy, max_step, *_) = model.numbers["run"]
    rows = []
    for time in times:
        assert instance.Run(time, accuracy, max_step) == 0
        rows.append(instance.Rows()[1][-1])
    places = SignalPlaces(model.run.evaluator, SignalsOf(diagram))
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
