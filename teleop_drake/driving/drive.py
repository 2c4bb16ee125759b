"""Drives a scenario with a hand, in real time."""

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram

from teleop_drake.driving.controls import FullSpeed, Hand
from teleop_drake.driving.pace import Pace
from teleop_drake.driving.settings import LoadDriven, Settings
from teleop_drake.driving.view import View
from teleop_drake.operators import RecordedConfig
from teleop_drake.operators.hand import HandOperator
from teleop_drake.recording import Recording
from teleop_drake.scenario import CheckSteps, Scenario, ScenarioError
from teleop_drake.scenario.scenario import ScenarioFiles
from teleop_drake.simulation import simulate
from teleop_drake.simulation.run import LiveRun
from teleop_drake.teleoperator import MakeTeleoperator

Array = NDArray[np.float64]

PERIOD = 1 / 32
"""Between two pictures, s of simulated time."""

LONGEST_SEGMENT = 600.0
"""In s: after that the task begins anew."""

_WARM_UP = 0.05
"""Simulated time in s that calls everything once."""

# Shorter than any step, s.
_INSTANT = 1e-9

_NUM_STILL = 8
"""For so many pictures new settings stay as they are before they count."""


@dataclass(kw_only=True)
class Segment:
    """What was driven without a change of the settings.

    Attributes:
        settings: What was changed of the scenario.
        scenario: As it was driven; its start is where the segment began.
        recording: All signals.
        command: Rows of [time, v_d] in s and m/s (N, 1 + n), straight lines between
            them: what the operator of kind `recorded` takes.
        rate: Simulated s in a second.
        was_late: Whether the simulation could not keep up with the clock.
    """

    settings: Settings
    scenario: Scenario
    recording: Recording
    command: Array
    rate: float
    was_late: bool


class Drive:
    """Drives a scenario: a hand in the place of its operator, picture by picture.

    Every PERIOD the hand is read. The commanded velocity goes along a straight line
    from one reading to the next and so arrives one picture late. The rest of the loop
    is simulated as simulate() does it, and recorded.

    A change of the settings ends a segment and begins another one: a new diagram, from
    the pose where the tool is, at rest, with empty channels and an adaptive law that
    has learned nothing. Where no run may begin, behind the contact surface, it begins
    at the scenario's start. So does one that the hand asks to begin anew, and one that
    follows a run that diverged.

    Args:
        name_or_path: A built-in scenario or a YAML file.
        overrides: Of its fields, PATH=VALUE each.
        hand: What commands, and what is wished.
        view: What shows it; None: nothing does.
        duration: How long, s of simulated time; None: until the hand has enough.
        rate: Simulated s in a second; infinity: as fast as it goes.
        engine: What runs it, as simulate() takes it.
        say: Takes a line for the user.

    Attributes:
        segments: What was driven so far.

    Raises:
        ScenarioError: If the scenario cannot be read, is not valid, or is no
            teleoperation.
    """

    def __init__(
        self,
        name_or_path: str,
        overrides: Sequence[str] = (),
        *,
        hand: Hand,
        view: View | None = None,
        duration: float | None = None,
        rate: float = 1.0,
        engine: str = "auto",
        say: Callable[[str], None] = lambda line: None,
    ):
        self._name_or_path, self._overrides = name_or_path, list(overrides)
        self._base = LoadDriven(name_or_path, self._overrides)
        self._hand, self._view, self._say = hand, view, say
        self._left = math.inf if duration is None else duration
        self._rate, self._engine = rate, engine
        self._full_speed = FullSpeed(self._base)
        self._start: Array | None = None
        self._is_over = False
        self._warm: set[tuple[str, ...]] = set()
        self.segments: list[Segment] = []

    def Run(self) -> None:
        """Drives until the time is over, or the hand has enough, or Ctrl-C."""
        while not self._is_over and self._left > PERIOD / 2:
            settings = self._hand.Wanted()
            scenario = self._Load(settings, self._start)
            if self._WarmUp(scenario) == "interrupted":
                return
            segment = _Driven(
                scenario,
                settings,
                hand=self._hand,
                view=self._view,
                full_speed=self._full_speed,
                rate=self._rate,
                engine=self._engine,
            )
            self.segments.append(segment.Run())
            recording = self.segments[-1].recording
            self._left -= float(recording.time[-1])
            self._is_over = segment.wants_end or recording.termination == "interrupted"
            self._start = segment.next_start
            if segment.page_error:
                self._say(f"Ended: {segment.page_error}.")
            elif recording.termination == "diverged":
                self._say(f"Ended: {recording.reason}. It begins anew.")

    def _Load(self, settings: Settings, start: Array | None) -> Scenario:
        """Returns the scenario of a segment, from a start or else from its own."""
        scenario = self._LoadFrom(settings, start)
        while not _HasAcceptableSteps(scenario):
            scenario = dataclasses.replace(scenario, duration=scenario.duration / 2)
        return scenario

    def _WarmUp(self, scenario: Scenario) -> str:
        """Lets what is new in a scenario be compiled before the clock starts.

        Returns:
            How that ended; see Recording.
        """
        kinds = (
            scenario.controller.kind,
            scenario.forward_channel.kind,
            scenario.return_channel.kind,
        )
        if kinds in self._warm:
            return "completed"
        self._warm.add(kinds)
        operator = HandOperator(num_axes=scenario.num_axes)
        recording = simulate(
            dataclasses.replace(scenario, duration=_WARM_UP),
            teleoperator=MakeTeleoperator(scenario, operator=operator),
            engine=self._engine,
        )
        for note in recording.notes:
            self._say(note)
        return recording.termination

    def _LoadFrom(self, settings: Settings, start: Array | None) -> Scenario:
        overrides = [
            *self._overrides,
            *settings.Overrides(self._base),
            f"duration={min(self._left, LONGEST_SEGMENT)!r}",
        ]
        if start is not None:
            try:
                here = f"robot.start={start.tolist()!r}"
                return LoadDriven(self._name_or_path, [*overrides, here])
            except ScenarioError as error:
                self._say(f"It begins at the start of the task: {error}")
        try:
            return LoadDriven(self._name_or_path, overrides)
        except ScenarioError as error:
            # What was wished is not allowed; the scenario itself is.
            self._say(f"Not possible: {error}")
            duration = min(self._left, LONGEST_SEGMENT)
            return dataclasses.replace(self._base, duration=duration)


def _HasAcceptableSteps(scenario: Scenario) -> bool:
    """Returns whether a segment takes no more steps than simulate() accepts."""
    try:
        CheckSteps(scenario)
    except ScenarioError:
        return False
    return True


def IsOfPage(error: RuntimeError) -> bool:
    """Returns whether an error says that Meshcat's server has ended."""
    return "Meshcat" in str(error)


class _Driven:
    """One segment while it is driven.

    Attributes:
        next_start: Where the next one begins, m (n); None: at the task's start.
        wants_end: Whether the hand has enough.
        page_error: Why there is no hand any more; empty: there is one.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: Settings,
        *,
        hand: Hand,
        view: View | None,
        full_speed: float,
        rate: float,
        engine: str,
    ):
        self._scenario, self._settings, self._engine = scenario, settings, engine
        self._hand, self._view = hand, view
        self._full_speed = full_speed
        self._pace = Pace(rate)
        self.next_start: Array | None = None
        self.wants_end, self.page_error = False, ""
        n = scenario.num_axes
        self._operator = HandOperator(num_axes=n)
        self._diagram: Diagram = MakeTeleoperator(scenario, operator=self._operator)
        self._rows = [np.zeros(1 + n)]

    def Run(self) -> Segment:
        """Drives, and returns what happened."""
        if self._view is not None:
            self._view.Begin(self._scenario)
        recording = simulate(
            self._scenario,
            teleoperator=self._diagram,
            engine=self._engine,
            advance=self._Advance,
        )
        return Segment(
            settings=self._settings,
            scenario=self._scenario,
            recording=recording,
            command=np.array(self._rows),
            rate=self._pace.MeasuredRate(float(recording.time[-1])),
            was_late=self._pace.was_late,
        )

    def _Advance(self, run: LiveRun, duration: float) -> None:
        """Advances picture by picture, as long as there is a page; see simulate()."""
        try:
            self._AdvanceByPictures(run, duration)
        except RuntimeError as error:
            if not IsOfPage(error):
                raise
            self.wants_end, self.page_error = True, str(error)

    def _AdvanceByPictures(self, run: LiveRun, duration: float) -> None:
        num_still = 0
        self._pace.Start(0.0)
        while run.time < duration - _INSTANT:
            time, before = run.time, self._rows[-1][1:]
            end = min(len(self._rows) * PERIOD, duration)
            command = np.asarray(self._hand.Command(time), dtype=float)
            after = self._full_speed * np.clip(command, -1.0, 1.0)
            line = self._operator.Line(begin=time, end=end, before=before, after=after)
            run.Feed(self._operator, "line", line)
            run.AdvanceTo(end)
            self._rows.append(np.array([end, *after]))
            if run.has_ended:
                return
            signals = run.Signals()
            self._Show(end, signals)
            self._pace.Wait(end)
            wanted = self._hand.Wanted()
            num_still = 0 if wanted == self._settings else num_still + 1
            if self._hand.WantsEnd():
                self.wants_end = True
                return
            if self._hand.WantsAnew():
                return
            if num_still >= _NUM_STILL:
                self.next_start = np.array(signals["tool_position"])
                return

    def _Show(self, time: float, signals: dict[str, Array]) -> None:
        """Shows what is felt, and the scene."""
        n = self._scenario.num_axes
        if "felt_velocity" in signals:
            force, velocity = signals["force_command"], signals["felt_velocity"]
        else:  # The thesis's packets.
            force = signals["forward_packet_sent"][:n]
            velocity = signals["return_packet_received"][n:]
        self._hand.Show(force, velocity, self._pace.MeasuredRate(time))
        if self._view is not None:
            self._view.Draw(time, signals, force, velocity)


def AsRecorded(segment: Segment, file: str) -> Recording:
    """Returns the recording with a scenario that repeats what the hand did.

    Args:
        file: The CSV file with its command, as it is named in the scenario. Other files
            are named by absolute paths, so that the scenario can be written anywhere.
    """
    scenario = dataclasses.replace(
        segment.scenario,
        duration=float(segment.recording.time[-1]),
        surgeon=RecordedConfig(velocity=segment.scenario.surgeon.velocity, file=file),
    )
    for dotted, other in ScenarioFiles(segment.scenario).items():
        section, key = dotted.split(".")
        if section != "surgeon":
            config = dataclasses.replace(
                getattr(scenario, section), **{key: os.path.abspath(other)}
            )
            setattr(scenario, section, config)
    return dataclasses.replace(segment.recording, scenario=scenario)
