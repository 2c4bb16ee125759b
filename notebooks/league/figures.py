"""The figures of the league, and the table of felt stiffness."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from league.entries import OneAxis, ReadEntries
from league.felt import BAND, FELT_DELAY, FREQUENCIES
from league.statistics import Row, Values
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.transparency import FeltStiffness
from teleop_drake.study.figures.analysis import PlotFeltStiffness
from teleop_drake.study.figures.style import COLORS, GREY, Figure

SHOWN = (
    "damper to command",
    "linear core",
    "adaptive",
    "waves",
    "PD at the slave",
    "four channels",
    "direct force",
)
"""The architectures that have a colour in the figure; the others are grey."""

# Of each architecture by rule: how stiff a bone feels, and at which frequencies, rad/s.
# With both dampers it feels the same; the robust law and passivity control feel next
# to the law on which they stand.
FELT = (
    "direct force",
    "adaptive",
    "damper to ground",
    "waves",
    "P+d",
    "four channels",
    "position-position",
    "Smith + damper",
)
FELT_FREQUENCIES = (1.0, 5.0, 7.0)

_LONGEST = 8.0  # s


def Draw(table: Sequence[Row], runs: Sequence[Row], felt: Sequence[Row]) -> Figure:
    """Draws the league: who rests, at what price, and what the hand feels.

    Args:
        table: The rows of league.csv.
        runs: The rows of league_runs.csv.
        felt: The rows of league_felt.csv.
    """
    figure = Figure(figsize=(13, 4.6))
    left, middle, right = figure.subplots(1, 3)
    names = dict.fromkeys(str(row["architecture"]) for row in table)
    for name in sorted(names, key=lambda name: name in SHOWN):
        style: dict[str, Any] = {"color": GREY, "alpha": 0.4, "lw": 0.8}
        if name in SHOWN:
            style = {"color": COLORS[SHOWN.index(name)], "lw": 1.8, "label": name}
        own = [row for row in runs if _Is(row, name, "compromise")]
        _DrawRest(left, Values(own, "rest"), style)
        members = [row for row in table if row["architecture"] == name]
        _DrawPrice(middle, members, style)
        (heard,) = [row for row in felt if _Is(row, name, "compromise")]
        ratio = np.array([float(x) for x in str(heard["felt_by_bone"]).split()])
        right.loglog(FREQUENCIES, ratio, **style)
    left.set(xlabel="time since the contact [s]", xlim=(0, _LONGEST), ylim=(0, 1.02))
    left.set_title("held-out runs at rest on the bone [share]")
    middle.set_xlabel("time to the bone [times the commanded time]")
    middle.set_title("largest force [times a free mass's impact]")
    middle.set(xlim=(0.95, 1.7), ylim=(0.35, 4.0), yscale="log")
    middle.set_yticks([0.5, 1, 2, 4], ["0.5", "1", "2", "4"])
    middle.yaxis.set_minor_formatter(NullFormatter())
    right.axhline(1.0, color="black", lw=0.6, ls="--")
    right.axvspan(BAND[0], BAND[-1], color=GREY, alpha=0.15, lw=0)
    right.set(xlabel="frequency of the hand [rad/s]", ylim=(0.01, 10))
    right.set_title("|felt impedance| / |the bone's|")
    handles, labels = left.get_legend_handles_labels()
    order = np.argsort([SHOWN.index(label) for label in labels])
    figure.legend(
        [handles[i] for i in order],
        [labels[i] for i in order],
        loc="outside lower center",
        ncols=len(SHOWN),
    )
    return figure


def _Is(row: Row, architecture: str, member: str) -> bool:
    return (row["architecture"], row["member"]) == (architecture, member)


def _DrawRest(ax: Axes, rest: np.ndarray, style: dict[str, Any]) -> None:
    """Draws the share of the runs that are at rest, of all searches together."""
    times = np.linspace(0, _LONGEST, 400)
    shares = np.mean(rest.ravel() <= times[:, np.newaxis], axis=1)
    ax.plot(times, shares, **style)


def _DrawPrice(ax: Axes, members: Sequence[Row], style: dict[str, Any]) -> None:
    """Draws the medians of the compromise, with a line to the gains by rule."""
    points = {
        row["member"]: (row["arrival"], row["impact"])
        for row in members
        if row["runs"] == "all"
    }
    style = {key: value for key, value in style.items() if key != "label"}
    centre = points["compromise"]
    if "rule" in points:
        ax.plot(*np.transpose([centre, points["rule"]]), **style | {"lw": 0.8})
        ax.plot(*points["rule"], "v", ms=5, mfc="none", **style)
    ax.plot(*centre, "o", ms=8, **style)


def _ByRule(round_trip: float) -> dict[str, Any]:
    """Returns one_dof with each architecture of FELT, the gains by rule."""
    entries = ReadEntries()
    return {name: OneAxis(entries[name], {}, round_trip / 2) for name in FELT}


def FeltRows() -> list[list[str]]:
    """Returns the cells of the table of felt stiffness, N/m, in architectures.md."""
    rows = []
    for name, scenario in _ByRule(2 * FELT_DELAY).items():
        point = OperatingPoints(scenario)[-1]
        felt = FeltStiffness(scenario, point, FELT_FREQUENCIES)
        rows.append([name, *(f"{k:.3g}" for k in felt)])
    return rows


def DrawFelt() -> Figure:
    """Draws the felt stiffness against the frequency for three round trips."""
    return PlotFeltStiffness(
        {
            f"round trip {trip:g} s": _ByRule(trip)
            for trip in (0.04, 2 * FELT_DELAY, 0.5)
        }
    )
