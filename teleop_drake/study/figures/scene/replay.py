"""Page that plays recorded runs in three dimensions.

The runs stand one below the other and are played at the same time. Their signals are
shown by the living diagram; see teleop_drake.loops.page.
"""

import html
import json
import logging
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

from pydrake.geometry import Meshcat, MeshcatParams

from teleop_drake.loops.framework.arrays import Interval
from teleop_drake.loops.framework.files import WriteText
from teleop_drake.loops.framework.validation import CheckKind
from teleop_drake.loops.run.recording import Recording
from teleop_drake.model.blocks.environments import CONTACT, PUNCTURE
from teleop_drake.model.task_recording import CheckTaskRecording, TaskRecording
from teleop_drake.study.figures.scene.scene import (
    FORCE_COLOR,
    GHOST_OPACITY,
    AnimateRuns,
    FindOperator,
    LooksOf,
)
from teleop_drake.study.figures.style import GREY, RunColor

# Slow motion begins _SLOW_BEFORE s before a puncture or a contact, and ends _SLOW_AFTER
# s after the operator feels it. Only the first events of a kind are slowed down.
_SLOW_BEFORE = 0.05
_SLOW_AFTER = 0.15
_NUM_SLOW = 3

_PANEL = (
    "position: fixed; top: 0; padding: 8px 14px; font: 13px/1.4 Arial; "
    "background: #ffffffb0"
)

_FRAME_HEIGHT = 620  # pixels, in a notebook


class Replay:
    """A page that plays runs: one file, which opens in any browser without a network.

    A notebook shows it inline.

    Attributes:
        title: The title of the page.
        html: The page.
    """

    def __init__(self, title: str, text: str):
        self.title = title
        self.html = text

    def __repr__(self) -> str:
        return f"<Replay of {self.title}, {len(self.html) / 1e6:.1f} MB>"

    def _repr_html_(self) -> str:
        """Returns the page in an HTML frame."""
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" width="100%" '
            f'height="{_FRAME_HEIGHT}" title="Replay" style="border: 0"></iframe>'
        )

    def Save(self, path: str | Path) -> None:
        """Writes the page. It appears complete or not at all.

        Raises:
            OSError: If the file cannot be written.
        """
        WriteText(Path(path), self.html)


def MakeReplay(
    recordings: Recording | Mapping[str, TaskRecording],
    meshcat: Meshcat | None = None,
) -> Replay:
    """Makes a page that plays runs, one below the other.

    Args:
        recordings: A run, or several runs by their names on the page. All robots have
            the same number of axes.
        meshcat: The Meshcat to draw in, which keeps the drawing; by default a temporary
            one.

    Raises:
        ValueError: If there is no run, or the numbers of axes differ.
        ScenarioError: If a run is that of a Diagram, which has no scenario.
    """
    allowed = "a Recording, which simulate() returns, or several by their names"
    CheckKind("recordings", recordings, Recording | Mapping, allowed)
    given = [recordings] if isinstance(recordings, Recording) else recordings.values()
    runs = [CheckTaskRecording("recordings", run) for run in given]
    if isinstance(recordings, Recording):
        recordings = {runs[0].scenario.controller.kind.replace("_", " "): runs[0]}
    if meshcat is None:  # Its message with the address is of no use.
        logger = logging.getLogger("drake")
        level = logger.level
        logger.setLevel(logging.WARNING)
        meshcat = Meshcat(MeshcatParams(host="localhost", port=0))
        logger.setLevel(level)
    AnimateRuns(recordings, meshcat)
    # Meshcat's own page, with a panel and a player added.
    title = runs[0].scenario.name
    data = {"slow": [span for run in runs for span in _SlowSpans(run)]}
    player = (resources.files(__package__) / "player.html").read_text(encoding="utf-8")
    head, _, rest = meshcat.StaticHtml().rpartition("</body>")
    page = f"""{head}<div id="panel" style="{_PANEL}">{_Panel(title, recordings)}</div>
<script>const replay = {json.dumps(data, allow_nan=False)};</script>
{player}</body>{rest}"""
    return Replay(title, page)


def _SlowSpans(run: TaskRecording) -> list[Interval]:
    """Returns the spans of time in s that are played slowly."""
    delay = run.teleoperation.return_channel.delay if FindOperator(run) else 0.0
    return [
        (time - _SLOW_BEFORE, time + delay + _SLOW_AFTER)
        for name in (PUNCTURE, CONTACT)
        for time in run.EventTimes(name)[:_NUM_SLOW]
    ]


def _Panel(title: str, recordings: Mapping[str, TaskRecording]) -> str:
    """Returns the names of the runs and the legend, as HTML."""
    lines = [f"<b>{html.escape(title)}</b>"]
    for i, (name, run) in enumerate(recordings.items()):
        notes = []
        if FindOperator(run):
            loop = run.teleoperation
            there = loop.forward_channel.delay
            back = loop.return_channel.delay
            notes.append(f"{there:g} s forward, {back:g} s back")
        if run.termination != "completed":
            notes.append(f"{run.termination} at {run.time[-1]:.3g} s")
        note = f" ({'; '.join(notes)})" if notes else ""
        color = f'style="color: {RunColor(i)}"'
        lines.append(f"<b {color}>{html.escape(name)}</b>{note}")
    entries = [("■", GREY, 1.0, "the robot")]
    forces = "force on the tool"
    if any(map(FindOperator, recordings.values())):
        ghost = "ghost: the robot as the operator feels it"
        entries.append(("■", GREY, GHOST_OPACITY, ghost))
        forces += ", and of the operator's hand"
    entries.append(("➔", FORCE_COLOR, 1.0, forces))
    # The legend lists the materials of the first run.
    for surface in next(iter(recordings.values())).surfaces:
        name = surface.material.name if surface.material else surface.name
        color, opacity = LooksOf(surface)
        entries.append(("■", color, opacity + 0.4, html.escape(name)))
    lines += [
        f'<span style="color: {color}; opacity: {opacity:g}">{mark}</span> {text}'
        for mark, color, opacity, text in entries
    ]
    return "<br>".join(lines)
