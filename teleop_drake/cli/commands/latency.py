"""The command `teleop-drake latency`."""

import argparse
from typing import TYPE_CHECKING

from teleop_drake.cli import output
from teleop_drake.cli.exit_codes import DONE, FAILED, BadInput
from teleop_drake.cli.options import Names, RefuseOptions
from teleop_drake.cli.tables import Align
from teleop_drake.loops.framework.validation import ScenarioError, Show

if TYPE_CHECKING:
    import numpy as np

    from teleop_drake.model.tables import Table
    from teleop_drake.study.analysis.latency import Latency

# The names of the lags by their order, in sentences.
# Hidden packets are told if they are more than this share of the losses.
_VISIBLE = 0.02

_LAGS = ("none", "first order", "second order")


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "file",
        nargs="?",
        metavar="FILE",
        help="two recorded signals: CSV, a spreadsheet, and others",
    )
    what.add_argument(
        "--trace",
        metavar="FILE",
        help="report instead on measured delays (a table, or what ping printed): what "
        "they say, and what they mean for each architecture",
    )
    _AddSignalOptions(parser)
    parser.add_argument(
        "--out", metavar="FILE.csv", help="write the dead time as a trace of a channel"
    )
    _AddTraceOptions(parser)
    parser.add_argument("--quiet", action="store_true", help="show no progress")
    parser.add_argument("--figure", metavar="FILE", help="draw it: .png, .svg or .pdf")
    parser.add_argument(
        "--json", metavar="FILE", help="write the numbers as JSON; `-`: to stdout"
    )


def _AddSignalOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options for two recorded signals."""
    parser.add_argument(
        "--command",
        dest="command_column",
        metavar="COLUMN",
        help="the signal that leads; a name, or a number from 1",
    )
    parser.add_argument("--response", metavar="COLUMN", help="the signal that follows")
    parser.add_argument(
        "--time", metavar="COLUMN", help="the times (default: found by its name)"
    )
    parser.add_argument(
        "--time-unit", metavar="UNIT", help="s, ms, us or ns, if the file names none"
    )
    parser.add_argument(
        "--lag",
        metavar="ORDER",
        help="the largest lag of the response's own: none, first or second (default: "
        "second); a smaller one makes the interval shorter",
    )
    parser.add_argument(
        "--maximum",
        type=float,
        metavar="S",
        help="largest dead time considered, s (default: a quarter of the record, at "
        "most 10)",
    )


def _AddTraceOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options for a report on measured delays."""
    parser.add_argument(
        "--scenario",
        metavar="SCENARIO",
        help="of --trace: what is run over the delays (default: one_dof)",
    )
    parser.add_argument(
        "--controllers",
        type=Names,
        metavar="A,B,...",
        help="of --trace: controller.kind (default: every architecture)",
    )
    parser.add_argument(
        "--sample-period",
        type=float,
        metavar="S",
        help="of --trace: time between the packets of the loop, s (default: 0.01)",
    )


def Execute(args: argparse.Namespace) -> int:
    """Estimates the delay between two columns of a file, or reports on a trace."""
    output.CheckJson(args.json)
    output.CheckFile(args.out, "--out")
    output.CheckFile(args.figure, "--figure", ".png", ".svg", ".pdf")
    if args.trace is not None:
        RefuseOptions(args, _OF_SIGNALS, "left out with --trace")
        from teleop_drake.cli.trace_texts import ReportOnTrace

        return ReportOnTrace(args)
    RefuseOptions(args, _OF_TRACES, "left out without --trace")
    for name in ("command_column", "response"):
        if getattr(args, name) is None:
            option = "--" + name.removesuffix("_column")
            raise BadInput(f"{option}: must name a column of {args.file}")
    return _EstimateLatency(args)


# Options that belong to signals or to traces only, by their names in the arguments.
_OF_SIGNALS = (
    *("command_column", "response", "time", "time_unit"),
    *("lag", "maximum", "out"),
)
_OF_TRACES = ("scenario", "controllers", "sample_period")


def _EstimateLatency(args: argparse.Namespace) -> int:
    from teleop_drake.model.tables import ReadTable
    from teleop_drake.study.analysis.latency import EstimateLatency

    table = ReadTable("FILE", args.file)
    command = table.Find(args.command_column)
    response = table.Find(args.response)
    time = _Times(table, args)
    latency = EstimateLatency(
        time,
        table.Values(command),
        table.Values(response),
        lag=args.lag or "second",
        maximum=args.maximum,
    )
    written = _Write(args, latency)
    rows = f"{table.origin}: {len(time)} rows in {time[-1]:.4g} s"
    output.Tell(args, latency.ToRecord(), rows, _Sentences(latency), written=written)
    return DONE if latency.delay is not None else FAILED


def _Times(table: "Table", args: argparse.Namespace) -> "np.ndarray":
    """Returns the times of the rows since the first one, s.

    Raises:
        ScenarioError: If the column of the times, or its unit, is not clear.
    """
    from teleop_drake.model.tables.headers import IsTime, ParseHeader

    found = [name for name in table.names if IsTime(ParseHeader(name).key)]
    if args.time is not None:
        found = [table.Find(args.time)]
    if len(found) != 1:
        shown = ", ".join(map(Show, table.names))
        raise ScenarioError(
            f"{table.origin}: columns {shown}: must have one time; name it, for "
            f"example --time {Show((found or table.names)[0])}"
        )
    times = table.Times(found[0], args.time_unit)
    if times.unit is None:
        raise ScenarioError(
            f"{table.Place(found[0])}: must have a unit, in its header or as "
            "--time-unit s (s, ms, us or ns)"
        )
    return times.since_first


def _Write(args: argparse.Namespace, latency: "Latency") -> list[str]:
    """Writes trace and figure; returns their names."""
    written = []
    if args.out is not None and latency.delay is not None:
        from teleop_drake.model.channels.trace import WriteTrace

        WriteTrace(args.out, *latency.Trace())
        written.append(args.out)
    if args.figure is not None:
        from teleop_drake.study.figures.latency import PlotLatency
        from teleop_drake.study.figures.saving import SaveFigure

        SaveFigure(PlotLatency(latency), args.figure)
        written.append(args.figure)
    return written


def _Sentences(latency: "Latency") -> str:
    """Returns what was found, in words and in a table."""
    if latency.delay is None:
        return f"The record cannot tell the dead time: {latency.reason}."
    low, high = latency.interval
    lines = [["lag of the response", "dead time [ms]", "95 % interval [ms]", ""]]
    for order, (delay, (least, most)) in latency.by_lag.items():
        chosen = "chosen" if order == latency.lag.order else ""
        interval = f"{1e3 * least:.4g} to {1e3 * most:.4g}"
        lines.append([_LAGS[order], f"{1e3 * delay:.4g}", interval, chosen])
    texts = [
        f"Dead time {1e3 * latency.delay:.4g} ms, {1e3 * low:.4g} to {1e3 * high:.4g} "
        "ms at 95 % confidence",
        _Lag(latency),
        f"Drift {1e6 * latency.drift:.3g} us/s, standard error "
        f"{1e6 * latency.drift_error:.2g}",
        *_Spread(latency),
        _Losses(latency),
        f"Gain {latency.gain:.4g}, offset {latency.offset:.4g}, noise "
        f"{latency.noise:.3g}; the command explains {100 * latency.explained:.3g} %",
        Align(lines),
    ]
    return "\n".join(texts)


def _Lag(latency: "Latency") -> str:
    lag = latency.lag
    if lag.order == 0:
        return "The response has no lag of its own that the record shows"
    if lag.order == 1:
        return f"Lag of the response: first order, time constant {lag.time:.4g} s"
    return (
        f"Lag of the response: second order, natural frequency {1 / lag.time:.4g} "
        f"rad/s, damping ratio {lag.damping:.3g}"
    )


def _Spread(latency: "Latency") -> list[str]:
    if latency.spread is None or latency.spread_error is None:
        return ["The lag hides how the delay differs from row to row"]
    return [
        f"Spread from row to row {1e3 * latency.spread:.3g} ms, standard error "
        f"{1e3 * latency.spread_error:.2g}"
    ]


def _Losses(latency: "Latency") -> str:
    if latency.losses is None or latency.hidden is None:
        return "The response does not tell single packets, so that losses are unknown"
    most = f"{100 * latency.losses:.3g} %"
    if latency.hidden < _VISIBLE * latency.losses or latency.losses == 0:
        return f"Lost or too late {most}"
    least = f"{100 * (latency.losses - latency.hidden):.3g}"
    return (
        f"Lost or too late {least} to {most}: between two rows a packet may be "
        "replaced by the next one"
    )
