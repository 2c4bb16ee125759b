"""The runs of the league, and what a run comes to."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from league.entries import Entry, Gains
from teleop_drake.loops.run.recording import Recording
from teleop_drake.model.scenario import AsTeleoperation, Scenario, ScenarioError
from teleop_drake.model.scenario.tree import ToTree
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.tasks.insertion_metrics import (
    CollisionTime,
    ControlForceVariation,
    InsertionRun,
    PeakForce,
    RestTime,
)
from teleop_drake.study.sweep.any_plan import Programs
from teleop_drake.study.sweep.plan import PlanSweep, SweepPlan
from teleop_drake.study.sweep.study import LoadStudy

TRACES = sorted(Path(__file__).parent.glob("trace_*.csv"))
"""Files with delays, over which held-out runs go."""


class Outcome(NamedTuple):
    """What a run comes to; a value is infinite if the run does not have it.

    Attributes:
        is_bounded: Whether the run reaches its end.
        rest: Time to rest in s, after the contact or, if that is later, after the
            arrival of the operator's stop.
        late: Time between arrival and commanded arrival in s. An early tool has
            overshot.
        arrival: Time of arrival in multiples of the commanded one.
        impact: Largest force in multiples of a free mass's.
        effort: Total variation of the control force in multiples of the bone's force on
            a free mass.
    """

    is_bounded: bool
    rest: float
    late: float
    arrival: float
    impact: float
    effort: float


_NOTHING = Outcome(False, *[np.inf] * 5)


def FreeImpact(scenario: Scenario) -> float:
    """Returns the force in N of a free mass that meets the bone as commanded.

    A mass m with the speed v compresses the undamped force k d^p until
    k d^(p + 1)/(p + 1) = m v^2/2.
    """
    speed = float(np.linalg.norm(scenario.surgeon.velocity))
    inertia = scenario.Facts().Told("inertia", "robot")
    mass = 1 / np.linalg.inv(inertia)[0, 0]
    environment: Any = scenario.environment
    if environment.kind == "layers":
        return speed * float(np.sqrt(environment.layers[-1].stiffness * mass))
    k, p = environment.stiffness, environment.exponent
    depth = ((p + 1) * mass * speed**2 / (2 * k)) ** (1 / (p + 1))
    return float(k * depth**p)


def CommandedTime(scenario: Scenario) -> float:
    """Returns the time in s to the bone with the commanded speed."""
    (bone,) = [surface for surface in scenario.Surfaces() if surface.name == "contact"]
    distance = bone.point_W[0] - scenario.robot.start[0]
    return float(distance / np.linalg.norm(scenario.surgeon.velocity))


def OutcomeOf(scenario: Scenario, recording: Recording) -> Outcome:
    """Returns what a run comes to."""
    run = InsertionRun(recording)
    contact = run.contact.time
    if recording.termination != "completed" or contact is None:
        return _NOTHING._replace(is_bounded=recording.termination == "completed")
    rest = RestTime(run)
    stop = scenario.surgeon.stop_time
    if rest is not None and stop is not None:
        waited = stop + scenario.forward_channel.delay - contact
        rest = max(rest - max(waited, 0.0), 0.0)
    free, commanded = FreeImpact(scenario), CommandedTime(scenario)
    arrival = CollisionTime(run)
    return Outcome(
        is_bounded=True,
        rest=np.inf if rest is None else rest,
        late=abs(arrival - commanded),
        arrival=arrival / commanded,
        impact=PeakForce(run) / free,
        effort=float(ControlForceVariation(run)[0]) / free,
    )


class Runs:
    """The runs of a study with an entry, compiled once for all sets of gains."""

    def __init__(self, study: str, entry: Entry):
        plans = LoadStudy(study).plans
        if study.endswith("held_out"):
            plans = plans | _TracePlans()
        self.plans = {
            title: replace(plan, overrides=[*plan.overrides, *entry.overrides])
            for title, plan in plans.items()
        }
        self._programs: dict[str, Programs] = {title: {} for title in plans}
        self._scenarios: dict[tuple[str, int], Scenario] = {}

    def Simulate(self, gains: Gains) -> dict[str, Outcome]:
        """Returns the outcome of each run by its name."""
        return {
            f"{title}-{number}": self.SimulateOne(title, number, gains)
            for title, plan in self.plans.items()
            for number in range(len(plan.points))
        }

    def SimulateOne(self, title: str, number: int, gains: Gains) -> Outcome:
        """Returns the outcome of a run: a plan's title, and the number of its point."""
        plan = self.plans[title]
        values = {**gains, **plan.points[number]}
        if "-wrong" in title:
            values = {**_Believed(plan, gains), **values}
        try:
            return self._Simulate(title, number, values)
        except (ScenarioError, RuntimeError):
            # Gains that a rule refuses, or a solver that cannot go on.
            return _NOTHING

    def _Simulate(self, title: str, number: int, values: Mapping[str, Any]) -> Outcome:
        plan = self.plans[title]
        recording = plan.Simulate(values, self._programs[title])
        key = (title, number)
        if key not in self._scenarios:
            # Outcomes do not depend on the gains.
            self._scenarios[key] = AsTeleoperation(plan.Load(values))
        return OutcomeOf(self._scenarios[key], recording)


def _Believed(plan: SweepPlan, gains: Gains) -> dict[str, Any]:
    """Returns what the rules of an architecture derive from a plan's own scenario.

    In the runs named `wrong` the rules believe that delay and mass are the scenario's.
    """
    scenario = AsTeleoperation(plan.Load(gains))
    given, derived = scenario.controller.Chosen(), ResolveController(scenario)
    fields = {key: key for key, x in ToTree(given).items() if x is None}
    if hasattr(derived, "Psi0"):
        fields = {"initial_psi": "Psi0"}
    path = scenario.controller.path
    return {f"{path}.{key}": ToTree(getattr(derived, x)) for key, x in fields.items()}


@cache
def _TracePlans() -> dict[str, SweepPlan]:
    """Returns the held-out runs over networks with the delays of files."""
    channels = [
        {"kind": "network", "delay": 0.0, "sample_period": 0.01, "trace": str(file)}
        | {"trace_end": "repeat"}
        for file in TRACES
    ]
    accuracy = {"one_dof": 1e-9, "two_dof_collision": 1e-7, "two_dof_combined": 1e-7}
    return {
        f"{name}-network-trace": PlanSweep(
            name, {"channel": channels}, overrides={"simulator.accuracy": value}
        )
        for name, value in accuracy.items()
    }
