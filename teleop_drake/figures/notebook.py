"""A run in a notebook: its metrics and a small figure."""

import base64
import html
import io

from teleop_drake.figures.runs import PlotRun
from teleop_drake.figures.saving import DescribeFigure
from teleop_drake.recording import Recording
from teleop_drake.sweep import FlattenMetrics, MetricUnits
from teleop_drake.tasks import TaskOf
from teleop_drake.tasks.metrics import RunSummary

_DPI = 90

# Of a teleoperation; `recording.plot()` shows all.
_SIGNALS = ("tool_velocity", "environment_force")


def RecordingHtml(recording: Recording) -> str:
    """Returns a run as HTML: its line, the table of its metrics and its figure.

    Args:
        recording: A run. One without a finite sample has no table and no figure.
    """
    title = f"<p>{html.escape(repr(recording))}</p>"
    reasons = [recording.reason, *recording.notes]
    title += "".join(f"<p>{html.escape(text)}</p>" for text in reasons if text)
    try:
        table = _Table(recording)
    except ValueError:
        return title
    buffer = io.BytesIO()
    is_compared = bool(TaskOf(recording.scenario).controllers)
    figure = PlotRun(recording, signals=_SIGNALS if is_compared else None, columns=1)
    figure.savefig(buffer, format="png", dpi=_DPI)
    image = base64.b64encode(buffer.getvalue()).decode()
    alternative = html.escape(DescribeFigure(figure), quote=True)
    return (
        f'{title}<div style="display: flex; flex-wrap: wrap; gap: 1em">{table}'
        f'<img alt="{alternative}" src="data:image/png;base64,{image}"></div>'
    )


def _Table(recording: Recording) -> str:
    """Returns the metrics of a run as an HTML table."""
    summary = RunSummary(recording)
    units = MetricUnits(recording.scenario)
    metrics = FlattenMetrics(summary["metrics"] | summary.get("channels", {}))
    rows = []
    for name, value in metrics.items():
        shown = _Cell(value)
        label = name.replace("_", " ").replace(".", " ")
        rows.append(
            f'<tr><td style="text-align: left">{html.escape(label)}</td>'
            f"<td>{shown}</td><td>{html.escape(units.get(name, ''))}</td></tr>"
        )
    return f"<table>{''.join(rows)}</table>"


def _Cell(value: object) -> str:
    """Returns a metric as text."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.5g}" if isinstance(value, float) else html.escape(str(value))
