"""Stability of a scenario's loop at its operating points; see point_stability.

An operator may close one loop before contact and another one after it: the operator of
the thesis commands a velocity until it perceives contact, and then holds a force. A
PointStability describes the loop with the velocity command, and its attribute
force_mode the loop that follows. The operator's block declares the force that it holds
(linear_part.HeldForce).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.framework import Diagram

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import CheckNumber, ScenarioError
from teleop_drake.model.blocks.environments import SurfacesOf
from teleop_drake.model.scenario import AsTeleoperation, Scenario, ScenarioLike
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.loop_model import LoopModel
from teleop_drake.study.analysis.operating_point import (
    IsBehindContact,
    OperatingPoint,
    OperatingPoints,
    PointOfRest,
)
from teleop_drake.study.analysis.point_stability import (
    MAX_DELAY,
    AnalyzeModel,
    PointStability,
)
from teleop_drake.study.numerics.delay_margin import is_delay_robust

NO_LOOP = "tracking has no loop with a delay"
"""The reason for refusing a task that is not a teleoperation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityAnalysis:
    """Stability of a scenario's loop at its operating points.

    Attributes:
        scenario: The scenario.
        forward_delay: The constant delay of the forward channel in s; see
            ChannelConfig.AsConstantDelay.
        return_delay: The constant delay of the return channel in s.
        max_delay: The largest round-trip delay of the intervals, in s.
        points: The stability at each operating point, in the order in which the tool
            reaches them.
        notes: The assumptions under which the margins hold, a sentence each.
    """

    scenario: Scenario
    forward_delay: float
    return_delay: float
    max_delay: float
    points: list[PointStability]
    notes: list[str]

    def __getitem__(self, label: str) -> PointStability:
        """Returns the loop with a label; see PointStability.label.

        Raises:
            KeyError: If there is no loop of that label.
        """
        return {loop.label: loop for loop in self.Loops()}[label]

    def Loops(self) -> list[PointStability]:
        """Returns the loops of all operating points, including those of held forces."""
        return [
            loop
            for point in self.points
            for loop in (point, point.force_mode)
            if loop is not None
        ]

    def ToRecord(self) -> Record:
        """Returns the JSON object of `teleop-drake analyze`."""
        return {
            "scenario": self.scenario.name,
            "controller": self.scenario.controller.kind,
            "forward_delay": self.forward_delay,
            "return_delay": self.return_delay,
            "max_delay": self.max_delay,
            "notes": self.notes,
            "operating_points": [point.ToRecord() for point in self.points],
        }


def AnalyzeStability(
    scenario: ScenarioLike,
    *,
    points: Iterable[OperatingPoint] | None = None,
    max_delay: float = MAX_DELAY,
    teleoperator: Diagram | None = None,
) -> StabilityAnalysis:
    """Analyses the stability of a scenario's loop against its delay.

    Args:
        scenario: A teleoperation, or its name or file. A delay that is not constant is
            replaced by a constant one; see ChannelConfig.AsConstantDelay.
        points: Operating points; by default those of OperatingPoints(scenario).
        max_delay: The largest round-trip delay of the intervals, in s, > 0.
        teleoperator: A Diagram made by MakeTeleoperator() for this scenario. It may
            contain your own systems. By default it is made from the scenario.

    Raises:
        ScenarioError: If the scenario is not valid, is not a teleoperation, or
            a channel is not a delay; if max_delay is not allowed; if Linearizer rejects
            a point; or if a station contains a delay that differs from the round trip.
        ValueError: If the loop is not well posed without delay.
    """
    scenario = AsTeleoperation(scenario, NO_LOOP)
    scenario.Validate()
    CheckNumber("max_delay", max_delay, "s", above=0)
    forward, back = scenario.ConstantDelays()
    delay = forward.delay + back.delay
    linearizer = Linearizer(scenario, teleoperator)
    if points is None:
        environment = linearizer.diagram.GetSubsystemByName("environment")
        points = OperatingPoints(scenario, environment=environment)
    models = [linearizer.Loop(point) for point in points]
    # The notes are the assumptions about channels, operator, loop and gains. The blocks
    # are the same at all points, so that the first model suffices for the loop's.
    notes = [note for note in (forward.note, back.note) if note]
    operator_note = scenario.surgeon.LinearNote()
    if teleoperator is None and operator_note is not None:
        notes.append(operator_note)
    for model in models[:1]:
        notes += _Assumptions(model, delay)
    if scenario.controller.Chosen().has_gains_of_delay:
        notes.append(
            "Gains that derive from the delay keep the values that they have for "
            f"{scenario.forward_channel.delay + scenario.return_channel.delay:g} s, "
            "whatever the delay."
        )
    # At each point the loop with the velocity command is analysed and, behind a contact
    # surface, the loop in which the operator holds a force.
    results = [
        _WithForceMode(
            AnalyzeModel(model, delay=delay, max_delay=max_delay), scenario, linearizer
        )
        for model in models
    ]
    notes += [point.untold for point in results if point.untold]
    if not all(is_delay_robust(point.loop) for point in results):
        notes.append(
            "The loop is of neutral type, and a signal that goes round it without any "
            "dynamics is not attenuated: with every delay, infinitely many roots lie "
            "to the right of the imaginary axis or approach it, and no delay counts as "
            "stable."
        )
    return StabilityAnalysis(
        scenario=scenario,
        forward_delay=forward.delay,
        return_delay=back.delay,
        max_delay=max_delay,
        points=results,
        notes=notes,
    )


def _WithForceMode(
    velocity_mode: PointStability, scenario: Scenario, linearizer: Linearizer
) -> PointStability:
    """Adds the loop after contact at an operating point, if the operator changes it."""
    point = velocity_mode.model.point
    environment = linearizer.diagram.GetSubsystemByName("environment")
    is_behind = IsBehindContact(SurfacesOf(environment) or (), point.position)
    if not is_behind or point.holds_force:
        return velocity_mode
    # The loop with a held force is analysed at the point at which the tool then rests.
    # If there is no such loop, the reason becomes a note.
    held = linearizer.held_force
    try:
        if held is None:
            if scenario.surgeon.contact_force is None:
                return velocity_mode
            raise ScenarioError(f"{scenario.surgeon.kind} does not tell it")
        rest = PointOfRest(point, environment, held.force)
        if rest is None:
            raise ScenarioError("the tool does not rest under it")
        model = linearizer.Loop(rest)
    except ScenarioError as e:
        untold = (
            f"The loop in {point.name} once the operator holds a force there is not "
            f"known: {e}."
        )
        return replace(velocity_mode, untold=untold)
    force_mode = AnalyzeModel(
        model, delay=velocity_mode.delay, max_delay=velocity_mode.max_delay
    )
    return replace(velocity_mode, force_mode=force_mode)


def _Assumptions(model: LoopModel, delay: float) -> list[str]:
    """Returns the assumptions of the model in addition to small deviations."""
    notes = []
    if model.inner_delays:
        # Delays inside of a station must equal the round trip, so that there is only
        # one delay.
        for inner in model.inner_delays:
            if not np.isclose(inner, delay, rtol=1e-9, atol=0):
                raise ScenarioError(
                    f"delay inside of a station = {inner:g}: must be the round trip, "
                    f"{delay:g} s, because the loop would have two delays"
                )
        notes.append(
            "The delay inside of the predictor is taken to be the round trip, at every "
            "delay."
        )
    if model.by_differences:
        names = ", ".join(model.by_differences)
        notes.append(
            f"Slopes by central differences, without conversion to AutoDiffXd: {names}."
        )
    if model.frozen_weights:
        values = "initial values" if model.point.estimates is None else "values there"
        notes.append(f"The weights of the adaptive law are frozen at their {values}.")
    if model.idle_passivity:
        notes.append(
            "The passivity controllers are taken to inject nothing, as long as there "
            "is energy to spend: the loop is then that of direct force. Once they act "
            "the loop has no linear model, and the margins do not hold."
        )
    return notes
