"""Recorded runs in the scene, as an animation: one below the other, in one time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from teleop_drake.figures.scene.actor import NUM_BEADS, Actor, Moment
from teleop_drake.figures.scene.pen import FRAMES_PER_SECOND, AnimationPen
from teleop_drake.figures.scene.scene import (
    DotPeriod,
    NewtonsOf,
    OperatorSignals,
    Opposite,
)
from teleop_drake.figures.scene.stage import (
    SCENE,
    DrawSlabs,
    MakeStage,
    SetUpView,
    SlabLabels,
    Stage,
)
from teleop_drake.figures.scene.visuals import RobotVisuals
from teleop_drake.figures.selection import CheckRecordings
from teleop_drake.recording import Recording

Array = NDArray[np.float64]

# Pictures per second, at normal times and around what happens; the latter is played in
# slow motion.
_RATE, _DENSE_RATE = 30.0, 150.0

# How long before and after what happens pictures are dense, s.
_BEFORE, _AFTER = 0.1, 0.3

# At most so much of a run is dense: one that bounces is nothing but events.
_MOST_DENSE = 3.0

# Share of the samples of a force that are smaller than that of the longest arrow.
_SHARE = 99.0

# A packet that is lost goes this share of its way.
_LOST_AT = 0.5

CHANNELS = {"forward": "forward_channel", "return": "return_channel"}
"""The lanes of the packets, and the fields of a scenario."""


@dataclass(frozen=True, kw_only=True)
class Act:
    """One run of a replay, in an order that the picture follows.

    Attributes:
        name: What it is called.
        path: Where in Meshcat it is.
        recording: The run.
        operator: What is felt and commanded, at the recording's times.
        visuals: Of the robot.
    """

    name: str
    path: str
    recording: Recording
    operator: OperatorSignals
    visuals: RobotVisuals

    @property
    def num_axes(self) -> int:
        """Number n of task axes."""
        return int(self.recording["tool_position"].shape[1])

    def Delay(self, lane: str) -> float:
        """Returns the channel's delay in s, its mean if it varies."""
        return float(getattr(self.recording.scenario, CHANNELS[lane]).delay)

    def At(self, samples: Array, times: Array) -> Array:
        """Returns samples (N, k) between those of the recording (M, k).

        Args:
            samples: At the recording's times.
            times: Ascending or not, clamped to the span of the recording (M,).
        """
        known = self.recording.time
        return np.stack([np.interp(times, known, x) for x in samples.T], -1)


def AnimateRuns(
    recordings: Mapping[str, Recording], meshcat: Meshcat
) -> tuple[list[Act], Stage]:
    """Puts runs into Meshcat as an animation, one below the other.

    Each of them is drawn as an Actor. Forces have one scale, that of the largest force
    but for rare peaks. Afterwards Meshcat's own controls play it.

    Args:
        recordings: By the names of the runs, the topmost first; of robots with as many
            axes.
        meshcat: Where to. What the package has drawn there before is deleted.

    Returns:
        The runs, and the stage that they share.

    Raises:
        ValueError: If there is none, or their numbers of axes differ.
    """
    CheckRecordings(recordings)
    acts = []
    for i, (name, recording) in enumerate(recordings.items()):
        acts.append(
            Act(
                name=name,
                path=f"{SCENE}/run_{i}",
                recording=recording,
                operator=OperatorSignals(
                    recording.signals, recording["tool_position"].shape[1]
                ),
                visuals=RobotVisuals(recording.scenario.robot),
            )
        )
    first = acts[0]
    stage = MakeStage(
        first.visuals,
        first.recording.surfaces,
        np.concatenate([act.recording["tool_position"] for act in acts]),
        num_runs=len(acts),
        has_operator=first.operator.felt is not None,
    )
    SetUpView(meshcat, stage)
    pen = AnimationPen()
    end = max(float(act.recording.time[-1]) for act in acts)
    newtons = _Newtons(acts)
    times = PictureTimes([act.recording for act in acts])
    for i, act in enumerate(acts):
        _AnimateRun(meshcat, pen, stage, act, i, newtons, times, end)
    meshcat.SetAnimation(pen.MakeAnimation())
    return acts, stage


def _AnimateRun(
    meshcat: Meshcat,
    pen: AnimationPen,
    stage: Stage,
    act: Act,
    run: int,
    newtons: float,
    times: Array,
    end: float,
) -> None:
    has_operator = act.operator.felt is not None
    flights = {lane: _Flights(act, lane) for lane in CHANNELS} if has_operator else {}
    slots = {lane: _AssignSlots(x) for lane, x in flights.items()}
    num_dots = max((max(x, default=-1) + 1 for x in slots.values()), default=0)
    actor = Actor(
        meshcat,
        act.path,
        run=run,
        visuals=act.visuals,
        stage=stage,
        newtons=newtons,
        num_dots=num_dots,
        has_operator=has_operator,
    )
    surfaces = act.recording.surfaces
    DrawSlabs(meshcat, f"{act.path}/environment", stage, act.visuals, surfaces)
    for name, p in SlabLabels(stage, act.visuals, surfaces).items():
        meshcat.SetTransform(f"{act.path}/labels/{name}", RigidTransform(p))
    for t, moment in zip(times, _Moments(act, times), strict=True):
        actor.Draw(pen.At(float(t)), moment)
    for lane, flying in flights.items():
        _AnimateDots(pen, actor, act, lane, flying, slots[lane], end)


def _Newtons(acts: Sequence[Act]) -> float:
    """Returns the force of the longest arrow, N."""
    forces = [act.recording["environment_force"] for act in acts]
    forces += [act.operator.force for act in acts if act.operator.force is not None]
    sizes = [
        float(np.percentile(np.linalg.norm(force, axis=1), _SHARE)) for force in forces
    ]
    return max(sizes) or NewtonsOf(acts[0].recording.scenario)


def PictureTimes(recordings: Sequence[Recording]) -> Array:
    """Returns the times in s of the pictures, dense around what happens."""
    end = max(float(recording.time[-1]) for recording in recordings)
    times = [np.arange(0.0, end, 1 / _RATE), np.array([end])]
    for recording in recordings:
        left = _MOST_DENSE
        for event in recording.events:
            begin, stop = event.time - _BEFORE, event.time + _AFTER
            left -= _BEFORE + _AFTER
            if left < 0:
                break
            times.append(np.arange(begin, stop, 1 / _DENSE_RATE))
    chosen = np.unique(np.round(np.concatenate(times) * FRAMES_PER_SECOND))
    chosen = chosen[(chosen >= 0) & (chosen <= np.ceil(end * FRAMES_PER_SECOND))]
    return np.asarray(chosen / FRAMES_PER_SECOND)


def _Moments(act: Act, times: Array) -> list[Moment]:
    """Returns what is seen of a run at some times; after its end, its end."""
    recording, operator = act.recording, act.operator
    samples = {"tool": recording["tool_position"]}
    if act.visuals.is_plant and "joint_position" in recording.signals:
        samples["joints"] = recording["joint_position"]
    if "desired_position" in recording.signals:
        samples["command"] = recording["desired_position"]
    elif operator.velocity is not None:
        samples["command"] = _CommandedPosition(act)
    if "environment_force" in recording.signals:
        force = Opposite(recording["environment_force"])
        assert force is not None
        samples["tool_force"] = force
    if operator.felt is not None:
        assert operator.force is not None
        samples |= {"felt": operator.felt, "hand_force": operator.force}
    columns = {name: act.At(x, times) for name, x in samples.items()}
    if operator.felt is not None:
        ages = np.arange(1, NUM_BEADS + 1) / (NUM_BEADS + 1) * act.Delay("return")
        past = act.At(recording["tool_position"], (times[:, None] - ages).ravel())
        columns["past"] = past.reshape(len(times), NUM_BEADS, act.num_axes)
    return [
        Moment(**{name: x[i] for name, x in columns.items()}) for i in range(len(times))
    ]


def _CommandedPosition(act: Act) -> Array:
    """Returns where the commanded velocity leads to from the start on (N, n), m."""
    velocity = act.operator.velocity
    assert velocity is not None
    steps = np.diff(act.recording.time)[:, None] * (velocity[1:] + velocity[:-1]) / 2
    start = act.recording["tool_position"][0]
    return np.asarray(start + np.vstack([0 * start, np.cumsum(steps, axis=0)]))


@dataclass(frozen=True)
class Flight:
    """A packet on its way: when it was sent, and when it arrives or is lost, s."""

    sent: float
    ends: float
    is_lost: bool


def _Flights(act: Act, lane: str) -> list[Flight]:
    """Returns the packets of a channel that are drawn, in the order of their sending.

    A continuous channel has no packets; what it carries is drawn as if it had.
    """
    scenario = act.recording.scenario
    channel = getattr(scenario, CHANNELS[lane])
    delay, end = act.Delay(lane), float(act.recording.time[-1])
    if delay < 1e-3:
        return []
    period = DotPeriod(delay)
    sent = np.arange(0.0, end, period)
    arrivals = channel.Arrivals(sent, scenario.duration, CHANNELS[lane])
    flights = []
    for begin, arrival in zip(sent.tolist(), arrivals.tolist(), strict=True):
        is_lost = not np.isfinite(arrival)
        stop = begin + _LOST_AT * delay if is_lost else arrival
        # Pictures are a millisecond apart.
        flights.append(Flight(begin, max(stop, begin + 2e-3), is_lost))
    return flights


def _AssignSlots(flights: Sequence[Flight]) -> list[int]:
    """Returns for each packet a dot that is free by then."""
    free_from: list[float] = []
    slots = []
    for flight in flights:
        free = [i for i, t in enumerate(free_from) if t + 5e-3 < flight.sent]
        if not free:
            free = [len(free_from)]
            free_from.append(0.0)
        free_from[free[0]] = flight.ends
        slots.append(free[0])
    return slots


def _AnimateDots(
    pen: AnimationPen,
    actor: Actor,
    act: Act,
    lane: str,
    flights: Sequence[Flight],
    slots: Sequence[int],
    end: float,
) -> None:
    """Lets each dot go from where its packet leaves to where it arrives."""
    tool = act.recording["tool_position"]
    source = act.operator.felt if lane == "forward" else tool
    assert source is not None
    froms = act.At(source, np.array([flight.sent for flight in flights]))
    tos = act.At(tool, np.array([flight.ends for flight in flights]))
    for i in range(actor.num_dots):
        path = f"{actor.path}/{lane}/{i}"
        pen.At(0.0).Show(path, False)
        pen.At(end).Show(path, False)
    for flight, slot, p, q in zip(flights, slots, froms, tos, strict=True):
        path = f"{actor.path}/{lane}/{slot}"
        begin, stop = actor.DotEnds(lane, p, q)
        if flight.is_lost:
            stop = begin + _LOST_AT * (stop - begin)
        ends = min(flight.ends, end)
        share = (ends - flight.sent) / (flight.ends - flight.sent)
        pen.At(flight.sent).Show(path, True)
        pen.Move(path, begin)
        pen.At(ends).Move(path, begin + share * (stop - begin))
        pen.Show(path, False)
