"""The programs of a sweep: runs that differ only in numbers share a program."""

import threading

from teleop_drake.scenario import ScenarioError
from teleop_drake.simulation import simulate
from teleop_drake.simulation.compiled_run import CannotCompile
from teleop_drake.simulation.compiled_scenario import CompiledScenario
from teleop_drake.sweep.plan import SweepPlan
from teleop_drake.sweep.values import Point
from teleop_drake.task_recording import TaskRecording

Programs = dict[tuple[tuple[str, str], ...], CompiledScenario]
"""The compiled scenarios of a sweep, by the texts among the values of their runs."""


class _Kept(threading.local):
    """The programs of the latest sweep in a thread of a worker.

    Attributes:
        sweep: The identifier of the sweep.
        programs: Its programs.
    """

    sweep = ""
    programs: Programs


_kept = _Kept()


def ProgramsOf(sweep: str) -> Programs:
    """Returns the programs that this thread has made for a sweep; they may be added to.

    An executor calls a worker once for some of the runs. Its later calls continue with
    these programs. Another sweep begins with none.

    Args:
        sweep: An identifier that no other sweep has.
    """
    if _kept.sweep != sweep:
        _kept.sweep = sweep
        _kept.programs = {}
    return _kept.programs


def SimulatePoint(plan: SweepPlan, point: Point, programs: Programs) -> TaskRecording:
    """Simulates a run, with a program of an earlier run if one fits.

    Args:
        plan: The sweep.
        point: The values of the run, by the keys of the grid.
        programs: The programs so far, to which a new program is added.

    Raises:
        ScenarioError: If the scenario of the run is not valid.
    """
    if plan.engine == "drake":
        return simulate(plan.Load(point), engine="drake")
    # The names of kinds decide the structure; most other values are numbers.
    names = tuple(
        (key, value) for key, value in point.items() if isinstance(value, str)
    )
    if names in programs:
        try:
            return programs[names].Run(**point)
        except ScenarioError:
            # The run needs another program, or Load() raises the error below.
            pass
    scenario = plan.Load(point)
    try:
        programs[names] = CompiledScenario(scenario)
    except CannotCompile:
        return simulate(scenario)
    return programs[names].Run()
