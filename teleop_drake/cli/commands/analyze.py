"""The command `teleop-drake analyze`."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.arrays import Record
from teleop_drake.cli import options, output
from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.cli.progress import SweepProgress
from teleop_drake.cli.tables import Align, Cell
from teleop_drake.validation import Refuse

if TYPE_CHECKING:
    from teleop_drake.analysis.stability import StabilityAnalysis
    from teleop_drake.analysis.stability_chart import StabilityChart
    from teleop_drake.analysis.transparency import Transparency

# Below this, in rad/s, nobody asks whether a mode is neutral.
_LEAST_UNRESOLVED = 1e-3

# More stable intervals than this do not fit a table; JSON has all.
_MAX_INTERVALS = 3

# A root this close to the imaginary axis, relative to its size, is on it.
_UNDAMPED = 1e-9

# What stands in the place of a delay margin.
_MARGIN_WORDS = {
    "stable": "at every delay",
    "unstable": "at every delay that was looked at",
    "windows": "unstable without delay, and stable at some larger ones",
    "absent": "the tool does not come to this layer",
}


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.epilog = (
        "All delays found are round trips: forward and return delay together, of which "
        "only the sum matters."
    )
    options.AddScenarioOptions(parser)
    parser.add_argument(
        "--max-delay",
        type=float,
        metavar="S",
        default=2.0,
        help="longest round-trip delay to report on, s (default: 2)",
    )
    parser.add_argument(
        "--vary",
        metavar="PATH=START:STOP:COUNT",
        help="chart the stable delays over a number of the scenario, for example "
        "environment.layers.bone.stiffness=10:400:40, or over the position of the tool "
        "along the normal of the surface, position=0.86:1.2:35",
    )
    options.AddFormatOption(parser)
    options.AddRunOptions(
        parser,
        json_help="write the margins as JSON; `-`: to stdout, and nothing else there",
        out_help="write Bode, Nyquist, stability, transparency and felt-stiffness "
        "plots and margins (.json) there",
        out_default=None,
    )


# The keys of the record whose names do not have their unit.
_UNITS = {
    key: unit
    for unit, keys in {
        "s": "forward_delay return_delay max_delay crossing_delays delay_margin "
        "stable_delays",
        "rad": "phase_margin",
        "rad/s": "gain_crossovers unresolved_below",
        "1/s": "rightmost_root slave_root hidden_modes",
        "m": "position",
        "m/s": "velocity",
    }.items()
    for key in keys.split()
}


def Execute(args: argparse.Namespace) -> int:
    """Prints delay margins, stability and transparency, and draws them."""
    from teleop_drake.analysis.loop import Linearizer
    from teleop_drake.analysis.stability import AnalyzeStability
    from teleop_drake.analysis.stability_chart import ChartStability
    from teleop_drake.analysis.transparency import AnalyzeTransparency

    scenario = options.Load(args)
    key, values = _VariedNumber(args.vary)
    output.CheckJson(args.json)
    stem = f"{scenario.name}_{scenario.controller.kind}"
    figures = ["bode", "nyquist", "stable_delays", "transparency", "felt_stiffness"]
    figures += ["chart"] * bool(key)
    formats = options.FormatsOf(args)
    *figure_paths, summary_path = output.PrepareFolder(
        args.out,
        *(f"{stem}_{name}.{suffix}" for name in figures for suffix in formats),
        f"{stem}_analysis.json",
    )
    # The chart first: it may refuse a value, and nobody should wait for that.
    chart = None
    if key:
        with SweepProgress(args.quiet, "values") as show:
            chart = ChartStability(
                args.scenario,
                key,
                values,
                overrides=options.OverridesOf(args),
                max_delay=args.max_delay,
                progress=show,
            )
    analysis = AnalyzeStability(scenario, max_delay=args.max_delay)
    linearizer = Linearizer(analysis.scenario, at_ports=True)
    transparency = [
        AnalyzeTransparency(analysis.scenario, point.model.point, linearizer=linearizer)
        for point in analysis.points
    ]
    # What is printed, drawn and written.
    record = analysis.ToRecord()
    record["units"] = _UNITS
    record["transparency"] = [point.ToRecord() for point in transparency]
    texts = [_AnalysisTable(record)]
    if chart is not None:
        record["chart"] = chart.ToRecord()
        texts += ["", _ChartTable(record["chart"])]
    written = []
    if args.out is not None:
        _Draw(figure_paths, analysis, transparency, chart)
        output.WriteText(summary_path, output.ToJson(record))
        written = [*figure_paths, summary_path]
    output.Tell(args, record, *texts, written=written)
    return 0


def _Draw(
    paths: Sequence[Path],
    analysis: "StabilityAnalysis",
    transparency: Sequence["Transparency"],
    chart: "StabilityChart | None",
) -> None:
    """Writes the figures, the chart last."""
    from teleop_drake.figures import analysis as figures
    from teleop_drake.figures.runs import SaveFigure

    made = [
        figures.PlotBode(analysis),
        figures.PlotNyquist(analysis),
        figures.PlotStableDelays(analysis),
        figures.PlotTransparency(transparency),
        figures.PlotFeltStiffness({"": {analysis.scenario.name: analysis.scenario}}),
        *([] if chart is None else [figures.PlotStabilityChart(chart)]),
    ]
    # The files of a figure stand together, one for each format.
    each = len(paths) // len(made)
    for i, figure in enumerate(made):
        SaveFigure(figure, *paths[i * each : (i + 1) * each])


def _VariedNumber(item: str | None) -> tuple[str, list[float]]:
    """Returns the key and the values of `analyze --vary`; without it, no key."""
    if item is None:
        return "", []
    from teleop_drake.sweep import ParseValues, SweepError

    path, text = options.SplitVary(item, "PATH=START:STOP:COUNT")
    try:
        values = ParseValues(text)
    except SweepError as e:
        raise BadInput(f"--vary {path} = {e}") from None
    if not all(isinstance(x, int | float) and math.isfinite(x) for x in values):
        Refuse(f"--vary {path}", text, "finite numbers")
    if len(set(values)) < 2:
        Refuse(f"--vary {path}", text, "two values or more")
    return path, [float(x) for x in values]


def _AnalysisTable(record: Record) -> str:
    """Returns the margins of `analyze`: a row for each operating point."""
    points = _Loops(record)
    delay = record["forward_delay"] + record["return_delay"]
    places_across = {tuple(point["position"][1:]) for point in points}
    num_shown = 1 if len(places_across) == 1 else None  # Along x one is enough.
    place = "x [m]" if num_shown else "position [m]"
    head = ["", place, "crossovers [rad/s]", "phase margin [deg]", "delay margin [s]"]
    lines = [[*head, "stable delays [s]", f"root at {delay:g} s [1/s]", ""]]
    for point in points:
        intervals = [
            f"{begin:.4g}-{end:.4g}" + "+" * (end == record["max_delay"])
            for begin, end in point["stable_delays"]
        ]
        intervals[_MAX_INTERVALS:] = ["..."] * (len(intervals) > _MAX_INTERVALS)
        phase = point["phase_margin"]
        root = point["rightmost_root"]
        lines.append(
            [
                point["name"],
                ", ".join(f"{x:.5g}" for x in point["position"][:num_shown]),
                ", ".join(f"{w:.4g}" for w in point["gain_crossovers"] if w) or "-",
                "-" if phase is None else f"{math.degrees(phase):.1f}",
                Cell(point["delay_margin"]),
                ", ".join(intervals) or "none",
                "-" if root is None else _Root(*root),
                _State(point),
            ]
        )
    text = [
        f"{record['scenario']}, {record['controller']}: delay "
        f"{record['forward_delay']:.6g} s forward, {record['return_delay']:.6g} s "
        f"back; round-trip delays up to {record['max_delay']:g} s",
        Align(lines),
    ]
    text += _OperatorLine(record["operating_points"])
    text += _Verdict(points, delay)
    slow = [point for point in points if point["unresolved_below"] > _LEAST_UNRESOLVED]
    if slow:
        sizes = [f"{x['unresolved_below']:.2g} ({x['name']})" for x in slow]
        text.append(
            "Slower than the tool's motion there, and not counted: below "
            f"{', '.join(sizes)} rad/s."
        )
    if all(point["absolutely_stable"] is not None for point in record["transparency"]):
        text.append(_AbsoluteStability(record["transparency"]))
    return "\n".join(text + record["notes"])


def _Loops(record: Record) -> list[Record]:
    """Returns the operating points, each followed by the loop of a held force."""
    loops: list[Record] = []
    for point in record["operating_points"]:
        loops.append(point)
        force_mode = point["force_mode"]
        if force_mode is not None:
            loops.append(force_mode | {"name": f"{point['name']}, force held"})
    return loops


def _OperatorLine(points: Sequence[Record]) -> list[str]:
    """Returns a sentence: what the operator does behind the contact surface."""
    names = [point["name"] for point in points if point["force_mode"] is not None]
    if not names:
        return ["The operator commands a velocity at every point shown."]
    return [
        f"In {name} the operator commands a velocity until it perceives contact, and "
        f"holds a force from then on: {name}, force held."
        for name in names
    ]


def _AbsoluteStability(points: Sequence[Record]) -> str:
    """Returns a sentence: whether operator and environment may be any passive ones."""
    failing = [point["name"] for point in points if not point["absolutely_stable"]]
    every = "stable with every passive operator and environment: Llewellyn's parameter"
    if failing:
        return f"Not {every} falls below 1 ({', '.join(failing)})."
    return f"{every[0].upper() + every[1:]} is 1 or more everywhere."


def _Verdict(points: Sequence[Record], delay: float) -> list[str]:
    """Returns sentences: where the loop fails first and why, and what it does now."""
    text = []
    # Where it fails without any delay.
    failing = [
        point["name"]
        for point in points
        if not point["stable_delays"] or point["stable_delays"][0][0] != 0
    ]
    if failing:
        text.append(f"Not stable even without delay: {', '.join(failing)}.")
    # Where it fails first as the delay grows.
    limits = [point for point in points if point["delay_margin"] is not None]
    if limits:
        least = min(limits, key=lambda point: point["delay_margin"])
        margin = least["delay_margin"]
        frequency = least["gain_crossovers"][least["crossing_delays"].index(margin)]
        place = "With a delay it fails first" if failing else "It fails first"
        text.append(
            f"{place} in {least['name']}, at {margin:.4g} s: the delay turns "
            f"the phase at {frequency:.4g} rad/s by all of its margin, "
            f"{math.degrees(least['phase_margin']):.1f} deg."
        )
    # How it moves where it is not stable at the scenario's delay.
    for point in points:
        root = point["rightmost_root"]
        if point["stable"] or root is None:
            continue
        if root[0] > 0 or _IsOnAxis(root):
            motion = f"a motion of {root[1]:.4g} rad/s" if root[1] else "a drift"
            change = "neither grows nor decays"
            if not _IsOnAxis(root):
                change = f"doubles every {math.log(2) / root[0]:.3g} s"
            text.append(f"At {delay:g} s, in {point['name']}, {motion} {change}.")
    return text


def _State(point: Record) -> str:
    """Returns whether the loop is stable."""
    root = point["rightmost_root"]
    if root is not None and not point["stable"] and _IsOnAxis(root):
        return "NOT DAMPED"
    return "stable" if point["stable"] else "UNSTABLE"


def _IsOnAxis(root: Sequence[float]) -> bool:
    """Returns whether a root (real, imaginary part) tells no growth and no decay."""
    return abs(root[0]) < _UNDAMPED * abs(root[1])


def _Root(real: float, imaginary: float) -> str:
    """Returns a characteristic root, or both of a pair."""
    real = 0.0 if _IsOnAxis((real, imaginary)) else real
    return f"{real:.4g}" + (f" ± {imaginary:.4g}j" if imaginary else "")


def _ChartTable(chart: Record) -> str:
    """Returns the delay margins of `analyze --vary`: a row for each value."""
    names: dict[str, None] = {}
    for analysis in chart["analyses"]:
        names |= dict.fromkeys(p["name"] for p in _Loops(analysis))
    lines = [[chart["key"], *(f"{name} [s]" for name in names), ""]]
    for value, analysis in zip(chart["values"], chart["analyses"], strict=True):
        points = {p["name"]: p for p in _Loops(analysis)}
        cells = [_Margin(points.get(name)) for name in names]
        lines.append([f"{value:g}", *cells, ""])
    shown = {cell for line in lines[1:] for cell in line[1:]}
    words = [f"{word}: {text}" for word, text in _MARGIN_WORDS.items() if word in shown]
    return "\n".join(["Delay margins", Align(lines), *words])


def _Margin(point: Record | None) -> str:
    """Returns the delay margin at an operating point, or why it has none."""
    if point is None:
        return "absent"
    if point["delay_margin"] is not None:
        return Cell(point["delay_margin"])
    intervals = point["stable_delays"]
    if not intervals:
        return "unstable"
    return "stable" if intervals[0][0] == 0 else "windows"
