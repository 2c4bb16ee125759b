"""Recorded runs in the scene: as an animation, and as a page that plays them.

The runs stand one below the other, in one time. What their signals say meanwhile is in
the living diagram; see teleop_drake.page.
"""

import html
import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform

from teleop_drake.environments import CONTACT, PUNCTURE
from teleop_drake.figures.scene.actor import (
    COMMAND_COLOR,
    FORCE_COLOR,
    FORWARD_COLOR,
    RETURN_COLOR,
    Actor,
    Moment,
)
from teleop_drake.figures.scene.pen import FRAMES_PER_SECOND, AnimationPen
from teleop_drake.figures.scene.scene import (
    CHANNELS,
    BeadAges,
    Between,
    FindOperator,
    NewtonsOf,
    OperatorSignals,
    Opposite,
)
from teleop_drake.figures.scene.stage import SCENE, MakeStage, NameOf, Stage
from teleop_drake.figures.scene.visuals import RobotVisuals
from teleop_drake.figures.selection import CheckRecordings
from teleop_drake.figures.style import GREY, RunColor
from teleop_drake.files import Replacing
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

# Packets that are under way for less are not drawn, s.
_SHORTEST_DELAY = 1e-3

# Time between two packets that are drawn: a share of the delay, and at least, s. At
# normal speed a screen shows some twenty pictures while a packet crosses three times
# this period; of more packets nobody would see which way they go.
_DOT_SHARE, _SHORTEST_PERIOD = 0.25, 0.05

# A packet that is lost goes this share of its way.
_LOST_AT = 0.5

# Slow motion begins so long before a puncture or a contact, and ends so long after it
# has been felt, s. Of a run that bounces the first contacts are shown so.
_SLOW_BEFORE, _SLOW_AFTER, _NUM_SLOW = 0.05, 0.15, 3

# Of more runs than these, only the first one has all its labels.
_MOST_NAMED = 3

_FRAME_HEIGHT = 620  # pixels, in a notebook


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
        """Returns samples (N, k) between those (M, k) at the recording's times."""
        return Between(times, self.recording.time, samples)


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
    acts = [
        Act(
            name=name,
            path=f"{SCENE}/run_{i}",
            recording=run,
            operator=FindOperator(run.signals, run["tool_position"].shape[1]),
            visuals=RobotVisuals(run.scenario.robot),
        )
        for i, (name, run) in enumerate(recordings.items())
    ]
    first = acts[0]
    stage = MakeStage(
        first.visuals,
        first.recording.surfaces,
        np.concatenate([act.recording["tool_position"] for act in acts]),
        num_runs=len(acts),
        has_operator=first.operator.felt is not None,
    )
    stage.SetUpView(meshcat)
    pen = AnimationPen()
    end = max(float(act.recording.time[-1]) for act in acts)
    newtons = _Newtons(acts)
    times = PictureTimes([act.recording for act in acts])
    for i, act in enumerate(acts):
        flights = {lane: _Flights(act, lane) for lane in CHANNELS}
        slots = [x.slot for flying in flights.values() for x in flying]
        actor = Actor(
            meshcat,
            act.path,
            run=i,
            visuals=act.visuals,
            stage=stage,
            newtons=newtons,
            num_dots=max(slots, default=-1) + 1,
            has_operator=act.operator.felt is not None,
        )
        surfaces = act.recording.surfaces
        stage.DrawSlabs(meshcat, f"{act.path}/environment", act.visuals, surfaces)
        for name, p in stage.SlabLabels(act.visuals, surfaces).items():
            meshcat.SetTransform(f"{act.path}/labels/{name}", RigidTransform(p))
        for t, moment in zip(times, _Moments(act, times), strict=True):
            actor.Draw(pen.At(float(t)), moment)
        for lane, flying in flights.items():
            _AnimateDots(pen, actor, act, lane, flying, end)
    meshcat.SetAnimation(pen.MakeAnimation())
    return acts, stage


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
        ages = BeadAges(act.Delay("return"))
        past = act.At(recording["tool_position"], (times[:, None] - ages).ravel())
        columns["past"] = past.reshape(len(times), len(ages), act.num_axes)
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
    """A packet on its way.

    Attributes:
        sent, ends: When it was sent, and when it arrives or is lost, s.
        is_lost: Whether it never arrives.
        slot: The number of the dot that it is, one that is free by then.
    """

    sent: float
    ends: float
    is_lost: bool
    slot: int


def _Flights(act: Act, lane: str) -> list[Flight]:
    """Returns the packets of a channel that are drawn, in the order of their sending.

    A continuous channel has no packets; what it carries is drawn as if it had.
    """
    if act.operator.felt is None or (delay := act.Delay(lane)) < _SHORTEST_DELAY:
        return []
    scenario = act.recording.scenario
    channel = getattr(scenario, CHANNELS[lane])
    period = max(_DOT_SHARE * delay, _SHORTEST_PERIOD)
    sent = np.arange(0.0, float(act.recording.time[-1]), period)
    arrivals = channel.Arrivals(sent, scenario.duration, CHANNELS[lane])
    flights = []
    free_from: list[float] = []
    for begin, arrival in zip(sent.tolist(), arrivals.tolist(), strict=True):
        is_lost = not np.isfinite(arrival)
        # Pictures are a millisecond apart.
        ends = max(begin + _LOST_AT * delay if is_lost else arrival, begin + 2e-3)
        free = [i for i, t in enumerate(free_from) if t + 5e-3 < begin]
        slot = free[0] if free else len(free_from)
        free_from[slot : slot + 1] = [ends]
        flights.append(Flight(begin, ends, is_lost, slot))
    return flights


def _AnimateDots(
    pen: AnimationPen,
    actor: Actor,
    act: Act,
    lane: str,
    flights: Sequence[Flight],
    end: float,
) -> None:
    """Lets each dot go from where its packet leaves to where it arrives."""
    tool = act.recording["tool_position"]
    source = act.operator.felt if lane == "forward" else tool
    if source is None:
        return
    froms = act.At(source, np.array([flight.sent for flight in flights]))
    tos = act.At(tool, np.array([flight.ends for flight in flights]))
    for i in range(actor.num_dots):
        path = f"{actor.path}/{lane}/{i}"
        pen.At(0.0).Show(path, False)
        pen.At(end).Show(path, False)
    for flight, p, q in zip(flights, froms, tos, strict=True):
        path = f"{actor.path}/{lane}/{flight.slot}"
        begin, stop = actor.DotEnds(lane, p, q)
        if flight.is_lost:
            stop = begin + _LOST_AT * (stop - begin)
        ends = min(flight.ends, end)
        share = (ends - flight.sent) / (flight.ends - flight.sent)
        pen.At(flight.sent).Show(path, True)
        pen.Move(path, begin)
        pen.At(ends).Move(path, begin + share * (stop - begin))
        pen.Show(path, False)


class Replay:
    """A page that plays runs: one file, which opens in any browser without a network.

    A notebook shows it inline.
    """

    def __init__(self, title: str, text: str):
        self.title = title
        self.html = text

    def __repr__(self) -> str:
        return f"<Replay of {self.title}, {len(self.html) / 1e6:.1f} MB>"

    def _repr_html_(self) -> str:
        """Returns the page in a frame of its own."""
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" width="100%" '
            f'height="{_FRAME_HEIGHT}" style="border: 0"></iframe>'
        )

    def Save(self, path: str | Path) -> None:
        """Writes the page. It appears complete or not at all.

        Raises:
            OSError: If the file cannot be written.
        """
        with Replacing(path) as temporary:
            temporary.write_text(self.html, encoding="utf-8")


def MakeReplay(
    recordings: Recording | Mapping[str, Recording], meshcat: Meshcat | None = None
) -> Replay:
    """Makes a page that plays runs, one below the other.

    Args:
        recordings: A run, or several by the names that the page gives them; of robots
            with as many axes.
        meshcat: What is drawn in, where it stays; None: one that is gone afterwards.

    Raises:
        ValueError: If there is none, or their numbers of axes differ.
    """
    if isinstance(recordings, Recording):
        kind = recordings.scenario.controller.kind.replace("_", " ")
        recordings = {kind: recordings}
    if meshcat is None:  # Nobody is going to see where it listens.
        logger = logging.getLogger("drake")
        level = logger.level
        logger.setLevel(logging.WARNING)
        meshcat = Meshcat(MeshcatParams(host="localhost", port=0))
        logger.setLevel(level)
    acts, _ = AnimateRuns(recordings, meshcat)
    data = _PageData(acts)
    player = resources.files(__package__) / "player.html"
    # A slash in a string could end the script.
    text = json.dumps(data, allow_nan=False).replace("</", "<\\/")
    tail = f"<script>const replay = {text};</script>\n"
    tail += player.read_text(encoding="utf-8")
    head, _, rest = meshcat.StaticHtml().rpartition("</body>")
    return Replay(data["title"], f"{head}{tail}</body>{rest}")


def _PageData(acts: Sequence[Act]) -> dict[str, Any]:
    """Returns what the player needs besides the scene, as plain data."""
    has_operator = acts[0].operator.felt is not None
    # Slow is what happens, until it has been felt.
    slow = [
        (
            time - _SLOW_BEFORE,
            time + (act.Delay("return") if has_operator else 0) + _SLOW_AFTER,
        )
        for act in acts
        for name in (PUNCTURE, CONTACT)
        for time in act.recording.EventTimes(name)[:_NUM_SLOW]
    ]
    return {
        "title": acts[0].recording.scenario.name,
        "subtitle": _Subtitle(acts),
        "end": max(float(act.recording.time[-1]) for act in acts),
        "runs": [
            {"name": act.name, "note": _Ending(act), "color": RunColor(i)}
            for i, act in enumerate(acts)
        ],
        "slow": slow,
        "labels": _Labels(acts),
        "legend": _Legend(acts, has_operator),
    }


def _Ending(act: Act) -> str:
    """Returns how a run ended, unless it is complete."""
    ended, end = act.recording.termination, float(act.recording.time[-1])
    return "" if ended == "completed" else f" ({ended} at {end:.3g} s)"


def _Subtitle(acts: Sequence[Act]) -> str:
    """Returns what the delays of all runs are, if they are the same."""
    if acts[0].operator.felt is None:
        return "a tracking: no operator, no delay"
    delays = {(act.Delay("forward"), act.Delay("return")) for act in acts}
    if len(delays) > 1:
        return "delays differ from run to run"
    forward, back = delays.pop()
    if forward == back:
        return f"{forward:g} s delay each way"
    return f"{forward:g} s delay forward, {back:g} s back"


def _Labels(acts: Sequence[Act]) -> list[dict[str, Any]]:
    """Returns the names that stand in the scene, at objects of Meshcat.

    A name stands `left` times its width to the left, and `below` pixels below.
    """

    def Label(act: Act, place: str, *values: Any) -> dict[str, Any]:
        path = [*act.path.strip("/").split("/"), *place.split("/")]
        names = ("path", "text", "color", "left", "below")
        return dict(zip(names, (path, *values), strict=True))

    labels = []
    is_crowded = len(acts) > _MOST_NAMED
    for i, act in enumerate(acts):
        is_named = not (is_crowded and i)
        tool = f"{act.name}: the tool" if is_named else act.name
        labels.append(Label(act, "robot/tip", tool, RunColor(i), 0.5, 26))
        if act.operator.felt is not None and is_named:
            felt = "as the operator feels it"
            labels.append(Label(act, "hand", felt, RunColor(i), 1.15, -22))
    # The materials are those of the first run.
    names = map(NameOf, acts[0].recording.surfaces)
    return labels + [
        Label(acts[0], f"labels/{name}", name, "#444444", 0.5, 0) for name in names
    ]


def _Legend(acts: Sequence[Act], has_operator: bool) -> list[dict[str, str]]:
    """Returns what the objects stand for; each mark is SVG, 20 by 14."""
    tint = RunColor(0) if len(acts) == 1 else GREY

    def Bar(color: str, opacity: float = 1.0) -> str:
        return f'<rect y="3" width="20" height="8" fill="{color}" opacity="{opacity}"/>'

    def Dot(color: str, radius: int) -> str:
        return f'<circle cx="10" cy="7" r="{radius}" fill="{color}"/>'

    command = f'<rect x="9" width="3" height="14" fill="{COMMAND_COLOR}"/>'
    arrow = f'<path d="M0 6h12v-4l8 5l-8 5v-4h-12z" fill="{FORCE_COLOR}"/>'
    entries = {"the robot": Bar(tint)}
    forces = "force on the tool"
    if has_operator:
        entries |= {
            "ghost: the robot as the operator feels it": Bar(tint, 0.4),
            "the operator's hand": Dot(tint, 6),
            "packets to the operator: where the tool was when they left": Dot(
                RETURN_COLOR, 4
            ),
            "packets to the robot: force and velocity": Dot(FORWARD_COLOR, 4),
        }
        forces += ", and of the operator's hand"
    entries |= {forces: arrow, "where the commanded motion is": command}
    return [{"mark": mark, "text": text} for text, mark in entries.items()]
