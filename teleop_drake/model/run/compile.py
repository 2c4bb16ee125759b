"""Compiles a scenario or a System once, and runs it with different numbers.

loop = Compile("one_dof")
for delay in (0.02, 0.07, 0.2):
    print(loop.Run(delay=delay).EventTimes("contact"))
"""

from typing import TYPE_CHECKING, overload

from pydrake.systems.analysis import SimulatorConfig
from pydrake.systems.framework import Context, System

from teleop_drake.loops.framework.signals import Signals
from teleop_drake.loops.framework.validation import RefuseGiven

if TYPE_CHECKING:
    from teleop_drake.loops.run.compiled_system import CompiledSystem
    from teleop_drake.model.run.compiled_scenario import CompiledScenario
    from teleop_drake.model.scenario import ScenarioLike


@overload
def Compile(scenario: "ScenarioLike") -> "CompiledScenario": ...


@overload
def Compile(
    scenario: System,
    *,
    context: Context | None = None,
    duration: float,
    simulator: SimulatorConfig | None = None,
    signals: Signals | None = None,
    suppress_initialization_events: bool = False,
) -> "CompiledSystem": ...


def Compile(
    scenario: "ScenarioLike | System",
    *,
    context: Context | None = None,
    duration: float | None = None,
    simulator: SimulatorConfig | None = None,
    signals: Signals | None = None,
    suppress_initialization_events: bool = False,
) -> "CompiledScenario | CompiledSystem":
    """Compiles a scenario, or a System, for many runs that differ in their numbers.

        pendulum = Compile(diagram, context=context, duration=10.0)
        recording = pendulum.Run(**{"plant.length": 2.0})

    Laws are traced now: values that they read from outside their arguments, such as
    global variables, are fixed.

    Args:
        scenario: The scenario, or its name or file; or a System.
        context: The Context where runs of a System begin; None: the default Context at
            the solver's start_time.
        duration: The duration of the runs of a System, s.
        simulator: The solver for a System; None: DefaultSimulator().
        signals: The signals of a System to record, as for simulate().
        suppress_initialization_events: As for simulate().

    Raises:
        ScenarioError: If the scenario is not valid.
        CannotCompile: If a block, or the solver, has no machine code; simulate() runs
            such a scenario in Drake.
    """
    if isinstance(scenario, System):
        from teleop_drake.loops.run import compiled_system

        return compiled_system.Compile(
            scenario,
            context=context,
            duration=duration,
            simulator=simulator,
            signals=signals,
            suppress_initialization_events=suppress_initialization_events,
        )
    RefuseGiven(
        "left out where a scenario is compiled",
        context=context,
        duration=duration,
        simulator=simulator,
        signals=signals,
        suppress_initialization_events=suppress_initialization_events,
    )
    from teleop_drake.model.run.compiled_scenario import CompiledScenario
    from teleop_drake.model.scenario import AsScenario

    return CompiledScenario(AsScenario(scenario))
