"""Runs, tables and block diagrams for a notebook."""

import base64
import html
import importlib
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.loops.draw.block_diagram import RenderSvg
from teleop_drake.loops.run.recording import Recording
from teleop_drake.model.signals import ScaleAndUnit
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.model.tasks import TaskOf
from teleop_drake.model.tasks.metrics import MissingInWords, RunSentence, RunSummary
from teleop_drake.study.figures.runs import PlotRun
from teleop_drake.study.figures.saving import DescribeFigure
from teleop_drake.study.sweep import FlattenMetrics, MetricUnits

_DPI = 90

# The figure beside the table keeps its height.
_SIDE_BY_SIDE = "display: flex; flex-wrap: wrap; gap: 1em; align-items: flex-start"

# The signals whose panels have the unit of a metric.
_UNIT_OF = {"N": "environment_force", "m/s": "tool_velocity", "m": "tool_position"}

# The signals of a teleoperation that are shown; PlotRun(recording) shows all.
_SIGNALS = ("tool_velocity", "environment_force")


def ShowTable(head: Sequence[str], *body: Sequence[Any]) -> None:
    """Shows rows of cells as a table; cells may have Markdown.

    Raises:
        ValueError: If a row does not have as many cells as the head.
    """
    display = importlib.import_module("IPython.display")
    for row in body:
        if len(row) != len(head):
            allowed = f"must have {len(head)} cells, and has {len(row)}"
            raise ValueError(f"row {tuple(row)}: {allowed}")
    rows = [head, ["---"] * len(head), *body]
    texts = [[str(cell).replace("|", r"\|") for cell in row] for row in rows]
    lines = ["| " + " | ".join(row) + " |" for row in texts]
    display.display(display.Markdown("\n".join(lines)))


def ShowDiagram(system: System, max_depth: int = 1) -> None:
    """Shows a block diagram, shrunk to the width of the page; see DiagramDot."""
    display = importlib.import_module("IPython.display")
    svg = RenderSvg(system, max_depth=max_depth)
    root = '<svg style="max-width: 100%; height: auto" '
    display.display(display.HTML(root + svg.partition("<svg ")[2]))


def RecordingHtml(recording: TaskRecording) -> str:
    """Returns a run as HTML: a summary line, notes, a table of metrics and a figure.

    Args:
        recording: A run; without a finite sample, it has no table and no figure.
    """
    text = Recording._repr_html_(recording)
    try:
        table = _Table(recording)
    except ValueError:
        return text
    sentence = html.escape(RunSentence(recording))
    title = f"<p>{sentence}</p>{text}" if sentence else text
    buffer = io.BytesIO()
    signals = _SIGNALS if TaskOf(recording.scenario).controllers else None
    figure = PlotRun(recording, signals=signals, columns=1)
    figure.savefig(buffer, format="png", dpi=_DPI)
    image = base64.b64encode(buffer.getvalue()).decode()
    alternative = html.escape(DescribeFigure(figure), quote=True)
    return (
        f'{title}<div style="{_SIDE_BY_SIDE}">{table}'
        f'<img alt="{alternative}" src="data:image/png;base64,{image}"></div>'
    )


def _Table(recording: TaskRecording) -> str:
    """Returns the metrics of a run as an HTML table."""
    summary = RunSummary(recording)
    units = MetricUnits(recording.scenario)
    metrics = FlattenMetrics(summary["metrics"] | summary.get("channels", {}))
    rows = []
    for name, value in metrics.items():
        label = html.escape(name.replace("_", " ").replace(".", " "))
        scale, unit = _ScaleOf(recording, units.get(name, ""))
        shown = value if scale == 1 or value is None else scale * value
        rows.append(
            f'<tr><td style="text-align: left">{label}</td>'
            f"<td>{_Cell(name, shown)}</td><td>{html.escape(unit)}</td></tr>"
        )
    return f"<table>{''.join(rows)}</table>"


def _ScaleOf(recording: TaskRecording, unit: str) -> tuple[float, str]:
    """Returns the scale and the unit that the figure has for metrics in an SI unit."""
    signal = recording.signals.get(_UNIT_OF.get(unit, ""))
    if signal is None:
        return 1.0, unit
    known = signal[np.isfinite(signal)]
    return ScaleAndUnit((known.min(), known.max()), unit)


def _Cell(name: str, value: object) -> str:
    """Returns a metric as text."""
    if value is None:
        return MissingInWords(name)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.5g}" if isinstance(value, float) else html.escape(str(value))
