"""The command `teleop-drake analyze`."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_drake.cli import options, output
from teleop_drake.cli.delay_maps import MapDelays, MapTable
from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.cli.progress import SweepProgress
from teleop_drake.cli.tables import Align, Cell
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.numerics.margins import remedy_words

if TYPE_CHECKING:
    from teleop_drake.study.analysis.point_stability import PointStability
    from teleop_drake.study.analysis.stability import StabilityAnalysis
    from teleop_drake.study.analysis.stability_chart import StabilityChart
    from teleop_drake.study.analysis.transparency import Transparency

# Limits of resolution below this, in rad/s, are not reported.
_LEAST_UNRESOLVED = 1e-3

# The largest number of stable intervals in a row of the table; JSON has all.
_MAX_INTERVALS = 3

# A root this close to the imaginary axis, relative to its size, is on it.
_UNDAMPED = 1e-9

# The words in the place of a delay margin, with their meanings.
_MARGIN_WORDS = {
    "stable": "at every delay",
    "unstable": "at every delay examined",
    "windows": "unstable without delay, and stable at some larger ones",
    "absent": "the tool does not reach this layer",
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
    parser.add_argument(
        "--map",
        action="store_true",
        help="print and draw how much later the signal of each connection may come",
    )
    options.AddFormatOption(parser)
    options.AddRunOptions(
        parser,
        json_help="write the margins as JSON; `-`: to stdout, and nothing else there",
        out_help="write Bode, Nyquist, stability, transparency and felt-stiffness "
        "plots and margins (.json) there",
        out_default=None,
    )


# The units of those keys of the record whose names do not contain them.
_UNITS = {
    "forward_delay": "s",
    "return_delay": "s",
    "max_delay": "s",
    "crossing_delays": "s",
    "delay_margin": "s",
    "stable_delays": "s",
    "phase_margin": "rad",
    "gain_crossovers": "rad/s",
    "unresolved_below": "rad/s",
    "stable_gains": "1",
    "rightmost_root": "1/s",
    "slave_root": "1/s",
    "hidden_modes": "1/s",
    "position": "m",
    "velocity": "m/s",
}


def Execute(args: argparse.Namespace) -> int:
    """Prints delay margins, stability and transparency, and draws them."""
    from teleop_drake.study.analysis.loop import Linearizer
    from teleop_drake.study.analysis.stability import AnalyzeStability
    from teleop_drake.study.analysis.stability_chart import ChartStability
    from teleop_drake.study.analysis.transparency import AnalyzeTransparency

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
    # The chart is first: if it refuses a value, the error appears without a wait.
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
    texts = [_AnalysisTable(analysis, transparency)]
    maps = []
    if args.map:
        maps = MapDelays(analysis)
        record["delay_map"] = {x.label: x.ToRecord() for x in maps}
        record["units"] = {**_UNITS, "delay_map": "s"}
        texts += ["", MapTable(maps)]
    if chart is not None:
        record["chart"] = chart.ToRecord()
        texts += ["", _ChartTable(chart)]
    written = []
    if args.out is not None:
        _Draw(figure_paths, analysis, transparency, chart)
        output.WriteText(summary_path, output.ToJson(record))
        written = [*figure_paths, summary_path]
        for x in maps:
            path = summary_path.with_name(f"{stem}_map_{x.stem}")
            written += x.Draw(path, formats)
    output.Tell(args, record, *texts, written=written)
    return 0


def _Draw(
    paths: Sequence[Path],
    analysis: "StabilityAnalysis",
    transparency: Sequence["Transparency"],
    chart: "StabilityChart | None",
) -> None:
    """Writes the figures, the chart last."""
    from teleop_drake.study.figures import analysis as figures
    from teleop_drake.study.figures.runs import SaveFigure

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
    from teleop_drake.study.sweep import ParseValues, SweepError

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


def _AnalysisTable(
    analysis: "StabilityAnalysis", transparency: "Sequence[Transparency]"
) -> str:
    """Returns a table of margins with a row for each loop, and sentences below it."""
    loops = analysis.Loops()
    delay = analysis.forward_delay + analysis.return_delay
    places_across = {tuple(loop.model.point.position[1:]) for loop in loops}
    # If all points lie on a line along x, only x is shown.
    num_shown = 1 if len(places_across) == 1 else None
    place = "x [m]" if num_shown else "position [m]"
    head = ["", place, "crossovers [rad/s]", "phase margin [deg]", "delay margin [s]"]
    lines = [[*head, "stable delays [s]", f"root at {delay:g} s [1/s]", ""]]
    for loop in loops:
        intervals = [
            f"{begin:.4g}-{end:.4g}" + "+" * (end == analysis.max_delay)
            for begin, end in loop.stable_delays
        ]
        intervals[_MAX_INTERVALS:] = ["..."] * (len(intervals) > _MAX_INTERVALS)
        crossovers = [f"{x.frequency:.4g}" for x in loop.crossings if x.frequency]
        margin = loop.margin
        root = loop.rightmost_root
        lines.append(
            [
                loop.label,
                ", ".join(f"{x:.5g}" for x in loop.model.point.position[:num_shown]),
                ", ".join(crossovers) or "-",
                f"{math.degrees(margin.phase_margin):.1f}" if margin else "-",
                Cell(margin and margin.delay),
                ", ".join(intervals) or "none",
                "-" if root is None else _Root(root),
                _State(loop),
            ]
        )
    text = [
        f"{analysis.scenario.name}, {analysis.scenario.controller.kind}: delay "
        f"{analysis.forward_delay:.6g} s forward, {analysis.return_delay:.6g} s "
        f"back; round-trip delays up to {analysis.max_delay:g} s",
        Align(lines),
    ]
    text += _OperatorLine(analysis.points)
    text += _Verdict(loops)
    slow = [loop for loop in loops if loop.unresolved > _LEAST_UNRESOLVED]
    if slow:
        sizes = ", ".join(f"{loop.unresolved:.2g} ({loop.label})" for loop in slow)
        text.append(
            "Roots slower than the tool's motion there are not counted: below "
            f"{sizes} rad/s."
        )
    if not any(point.idle_passivity for point in transparency):
        text.append(_AbsoluteStability(transparency))
    return "\n".join(text + analysis.notes)


def _OperatorLine(points: "Sequence[PointStability]") -> list[str]:
    """Returns sentences on the operator's command before and after contact."""
    names = [point.label for point in points if point.force_mode is not None]
    if not names:
        return ["The operator commands a velocity at every point shown."]
    return [
        f"In {name} the operator commands a velocity until it perceives contact, and "
        f"holds a force from then on: {name}, force held."
        for name in names
    ]


def _AbsoluteStability(points: "Sequence[Transparency]") -> str:
    """Returns a sentence on stability with every passive operator and environment."""
    failing = [x.point.name for x in points if not x.is_absolutely_stable]
    every = "stable with every passive operator and environment: Llewellyn's parameter"
    if failing:
        return f"Not {every} falls below 1 ({', '.join(failing)})."
    return f"{every[0].upper() + every[1:]} is 1 or more everywhere."


def _Verdict(loops: "Sequence[PointStability]") -> list[str]:
    """Returns sentences on the stability of the loop.

    They state where and why it fails first as the delay grows, how it moves at the
    scenario's delay, and what would stabilise it.
    """
    text = []
    failing = [loop.label for loop in loops if not _StartsStable(loop)]
    if failing:
        text.append(f"Not stable even without delay: {', '.join(failing)}.")
    # The point with the smallest delay margin fails first as the delay grows.
    limits = [(loop.margin, loop.label) for loop in loops if loop.margin]
    if limits:
        margin, label = min(limits, key=lambda limit: limit[0].delay)
        place = "With a delay it fails first" if failing else "It fails first"
        text.append(
            f"{place} in {label}, at {margin.delay:.4g} s: the delay turns "
            f"the phase at {margin.frequency:.4g} rad/s by all of its margin, "
            f"{math.degrees(margin.phase_margin):.1f} deg."
        )
    # The motion of each loop that is not stable at the scenario's delay.
    for loop in loops:
        root = loop.rightmost_root
        if loop.is_stable or root is None:
            continue
        if root.real > 0 or _IsOnAxis(root):
            motion = f"a motion of {root.imag:.4g} rad/s" if root.imag else "a drift"
            change = "neither grows nor decays"
            if not _IsOnAxis(root):
                change = f"doubles every {math.log(2) / root.real:.3g} s"
            text.append(f"At {loop.delay:g} s, in {loop.label}, {motion} {change}.")
        delays = loop.stable_delays[:_MAX_INTERVALS]
        remedy = remedy_words(loop.stable_gains, delays, "round-trip delay")
        text.append(f"In {loop.label}: {remedy}.")
    return text


def _StartsStable(loop: "PointStability") -> bool:
    """Returns whether the loop is stable without any delay."""
    return bool(loop.stable_delays) and loop.stable_delays[0][0] == 0


def _State(loop: "PointStability") -> str:
    """Returns a word for the stability of the loop."""
    if loop.is_stable:
        return "stable"
    root = loop.rightmost_root
    return "UNSTABLE" if root is None or not _IsOnAxis(root) else "NOT DAMPED"


def _IsOnAxis(root: complex) -> bool:
    """Returns whether a root is on the imaginary axis, up to rounding."""
    return abs(root.real) < _UNDAMPED * abs(root.imag)


def _Root(root: complex) -> str:
    """Returns a characteristic root, or a conjugate pair, as text."""
    real = 0.0 if _IsOnAxis(root) else root.real
    return f"{real:.4g}" + (f" ± {root.imag:.4g}j" if root.imag else "")


def _ChartTable(chart: "StabilityChart") -> str:
    """Returns a table of delay margins with a row for each value of `--vary`."""
    names = chart.PointNames()
    lines = [[chart.key, *(f"{name} [s]" for name in names), ""]]
    for value, analysis in zip(chart.values, chart.analyses, strict=True):
        cells = {loop.label: _Margin(loop) for loop in analysis.Loops()}
        lines.append([f"{value:g}", *(cells.get(x, "absent") for x in names), ""])
    shown = {cell for line in lines[1:] for cell in line[1:]}
    words = [f"{word}: {text}" for word, text in _MARGIN_WORDS.items() if word in shown]
    return "\n".join(["Delay margins", Align(lines), *words])


def _Margin(loop: "PointStability") -> str:
    """Returns the delay margin of a loop, or the word of _MARGIN_WORDS instead."""
    if loop.margin is not None:
        return Cell(loop.margin.delay)
    if not loop.stable_delays:
        return "unstable"
    return "stable" if _StartsStable(loop) else "windows"
