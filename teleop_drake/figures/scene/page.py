"""The page of a replay: the scene, a player, and what the signals say meanwhile."""

import html
import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat, MeshcatParams

from teleop_drake.environments import CONTACT, PUNCTURE
from teleop_drake.figures.scene.actor import (
    COMMAND_COLOR,
    FORCE_COLOR,
    FORWARD_COLOR,
    RETURN_COLOR,
)
from teleop_drake.figures.scene.replay import CHANNELS, Act, AnimateRuns
from teleop_drake.figures.scene.stage import Stage
from teleop_drake.figures.style import GREY, RunColor, ScaleAndUnit
from teleop_drake.files import Replacing
from teleop_drake.recording import Recording

Array = NDArray[np.float64]

# Samples of the strips, per second and at most.
_RATE, _MOST_SAMPLES = 200.0, 4000

# Width of the strips in round trips, and at least, s.
_ROUND_TRIPS, _SHORTEST_WINDOW = 8.0, 1.0

# Slow motion begins so long before a puncture or a contact, and ends so long after it
# has been felt, s. Of a run that bounces the first contacts are shown so.
_SLOW_BEFORE, _SLOW_AFTER, _NUM_SLOW = 0.05, 0.15, 3

# What the strips leave out at either end of the range of a signal, in percent.
_RARE = 0.2

_FRAME_HEIGHT = 620  # pixels, in a notebook


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
    if meshcat is None:
        with _Silence():
            meshcat = Meshcat(MeshcatParams(host="localhost", port=0))
    acts, stage = AnimateRuns(recordings, meshcat)
    data = _PageData(acts, stage)
    player = resources.files(__package__) / "player.html"
    # A slash in a string could end the script.
    text = json.dumps(data, allow_nan=False).replace("</", "<\\/")
    tail = f"<script>const replay = {text};</script>\n"
    tail += player.read_text(encoding="utf-8")
    head, _, rest = meshcat.StaticHtml().rpartition("</body>")
    return Replay(data["title"], f"{head}{tail}</body>{rest}")


@contextmanager
def _Silence() -> Iterator[None]:
    """Lets Drake not say where a Meshcat listens that nobody is going to see."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(level)


def _PageData(acts: Sequence[Act], stage: Stage) -> dict[str, Any]:
    """Returns what the player needs besides the scene, as plain data."""
    first = acts[0].recording.scenario
    end = max(float(act.recording.time[-1]) for act in acts)
    has_operator = acts[0].operator.felt is not None
    round_trip = (
        max(sum(act.Delay(lane) for lane in CHANNELS) for act in acts)
        if has_operator
        else 0.0
    )
    runs = [_RunData(act, stage, i) for i, act in enumerate(acts)]
    lags = [
        abs(x - felt)
        for run in runs
        for x, felt in zip(run["x"], run.get("felt", run["x"]), strict=True)
    ]
    lag_scale, lag_unit = ScaleAndUnit((0.0, max(lags)), "m")
    return {
        "title": first.name,
        "subtitle": _Subtitle(acts),
        "end": end,
        "window": min(max(_ROUND_TRIPS * round_trip, _SHORTEST_WINDOW), max(end, 1e-3)),
        "runs": runs,
        "events": _Events(acts),
        "jumps": _Jumps(acts),
        "slow": _SlowSpans(acts),
        "labels": _Labels(acts),
        "legend": _Legend(acts, has_operator),
        "lagScale": lag_scale,
        "lagUnit": lag_unit,
        "strips": [
            _Strip(runs, "m/s", ("v", "vf", "vd")),
            _Strip(runs, "N", ("f", "h")),
        ],
    }


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


def _RunData(act: Act, stage: Stage, run: int) -> dict[str, Any]:
    """Returns the samples of a run: along the stage's direction forward, SI units."""
    recording, operator, n = act.recording, act.operator, act.num_axes
    end = float(recording.time[-1])
    num_samples = int(min(max(_RATE * end, 2), _MOST_SAMPLES))
    times = np.linspace(0.0, end, num_samples)
    forward = stage.forward[:n]
    columns = {
        "x": recording["tool_position"],
        "v": recording["tool_velocity"],
        "f": recording["environment_force"],
        "felt": operator.felt,
        "vf": recording.signals.get("felt_velocity"),
        "vd": operator.velocity,
        "h": operator.force,
    }
    if columns["vf"] is None and operator.felt is not None:
        columns["vf"] = recording["return_packet_received"][:, n : 2 * n]
    if columns["vd"] is None:
        columns["vd"] = recording.signals.get("desired_velocity")
    samples = {
        name: _Short(act.At(x, times) @ forward)
        for name, x in columns.items()
        if x is not None
    }
    note = "" if recording.termination == "completed" else recording.termination
    if note:
        note += f" at {end:.3g} s"
    return {
        "name": act.name,
        "color": RunColor(run),
        "note": note,
        "t": _Short(times),
        **samples,
    }


def _Short(values: Array) -> list[float]:
    """Returns numbers with as many digits as a picture shows."""
    return [float(f"{x:.5g}") for x in values]


def _Strip(
    runs: Sequence[Mapping[str, Any]], unit: str, names: Sequence[str]
) -> dict[str, Any]:
    """Returns a strip: its range but for rare peaks, its ticks and its lines."""
    values = np.concatenate(
        [run[name] for run in runs for name in names if name in run]
    )
    low, high = np.percentile(values, [_RARE, 100 - _RARE])
    low, high = min(float(low), 0.0), max(float(high), 0.0)
    margin = 0.08 * (high - low) or 1.0
    scale, shown_unit = ScaleAndUnit((low, high), unit)
    ticks = [x for x in (low, 0.0, high) if x == 0 or abs(x) > 0.2 * (high - low)]
    style: dict[str, dict[str, Any]] = {
        "v": {"dash": []},
        "vf": {"dash": [8, 6]},
        "vd": {"dash": [3, 5], "color": COMMAND_COLOR},
        "f": {"dash": []},
        "h": {"dash": [8, 6]},
    }
    explained = {
        "v": "velocity of the tool",
        "vf": "felt - -",
        "vd": "commanded ···",
        "f": "force of the tool",
        "h": "of the operator - -",
    }
    has = [name for name in names if any(name in run for run in runs)]
    return {
        "label": f"{', '.join(explained[name] for name in has)} [{shown_unit}]",
        "low": low - margin,
        "high": high + margin,
        "ticks": ticks,
        "tickLabels": [f"{x * scale:.2g}" for x in ticks],
        "lines": [{"name": name, **style[name]} for name in names],
    }


def _Events(acts: Sequence[Act]) -> list[dict[str, Any]]:
    """Returns punctures and contacts of all runs, in the colours of the runs."""
    return [
        {"name": f"{act.name}: {event.name}", "time": event.time, "color": RunColor(i)}
        for i, act in enumerate(acts)
        for event in act.recording.events
        if event.name in (PUNCTURE, CONTACT)
    ]


def _Firsts(act: Act) -> dict[str, float]:
    """Returns the times of the first puncture and the first contact, s."""
    return {
        name: act.recording.EventTimes(name)[0]
        for name in (PUNCTURE, CONTACT)
        if act.recording.EventTimes(name)
    }


def _Jumps(acts: Sequence[Act]) -> list[dict[str, Any]]:
    """Returns the first puncture and the first contact of any run."""
    jumps: dict[str, float] = {}
    for act in acts:
        for name, time in _Firsts(act).items():
            jumps[name] = min(time, jumps.get(name, np.inf))
    return [{"name": name, "time": time} for name, time in jumps.items()]


def _SlowSpans(acts: Sequence[Act]) -> list[tuple[float, float]]:
    """Returns when it is played slowly: from what happens until it has been felt."""
    spans = []
    for act in acts:
        back = act.Delay("return") if act.operator.felt is not None else 0.0
        for name in (PUNCTURE, CONTACT):
            for time in act.recording.EventTimes(name)[:_NUM_SLOW]:
                spans.append((time - _SLOW_BEFORE, time + back + _SLOW_AFTER))
    return spans


# Of more runs than these, only the first one has all its labels.
_MOST_NAMED = 3


def _Labels(acts: Sequence[Act]) -> list[dict[str, Any]]:
    """Returns the names that stand in the scene, at objects of Meshcat.

    A name stands `left` times its width to the left, and `below` pixels below.
    """
    labels = []
    is_crowded = len(acts) > _MOST_NAMED
    for i, act in enumerate(acts):
        path = act.path.strip("/").split("/")
        color = RunColor(i)
        tool = act.name if is_crowded and i else f"{act.name}: the tool"
        texts = {"robot/tip": (tool, 0.5, 26)}
        if act.operator.felt is not None and not (is_crowded and i):
            texts["hand"] = ("as the operator feels it", 1.15, -22)
        for place, (text, left, below) in texts.items():
            labels.append(
                {
                    "path": [*path, *place.split("/")],
                    "text": text,
                    "color": color,
                    "left": left,
                    "below": below,
                }
            )
    # The materials are those of the first run.
    first = acts[0]
    for surface in first.recording.surfaces:
        name = surface.material.name if surface.material else surface.name
        labels.append(
            {
                "path": [*first.path.strip("/").split("/"), "labels", name],
                "text": name,
                "color": "#444444",
                "left": 0.5,
                "below": 0,
            }
        )
    return labels


def _Legend(acts: Sequence[Act], has_operator: bool) -> list[dict[str, str]]:
    """Returns what the objects stand for; each mark is SVG, 20 by 14."""
    tint = RunColor(0) if len(acts) == 1 else GREY

    def Bar(color: str, opacity: float = 1.0) -> str:
        return f'<rect y="3" width="20" height="8" fill="{color}" opacity="{opacity}"/>'

    def Dot(color: str, radius: int) -> str:
        return f'<circle cx="10" cy="7" r="{radius}" fill="{color}"/>'

    arrow = (
        f'<path d="M0 6h12v-4l8 5l-8 5v-4h-12z" fill="{FORCE_COLOR}"/>',
        "force on the tool" + ", and of the operator's hand" * has_operator,
    )
    command = (
        f'<rect x="9" width="3" height="14" fill="{COMMAND_COLOR}"/>',
        "where the commanded motion is",
    )
    entries = [(Bar(tint), "the robot"), arrow, command]
    if has_operator:
        entries[1:1] = [
            (Bar(tint, 0.4), "ghost: the robot as the operator feels it"),
            (Dot(tint, 6), "the operator's hand"),
            (
                Dot(RETURN_COLOR, 4),
                "packets to the operator: where the tool was when they left",
            ),
            (Dot(FORWARD_COLOR, 4), "packets to the robot: force and velocity"),
        ]
    return [{"mark": mark, "text": text} for mark, text in entries]
