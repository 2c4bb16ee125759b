"""The prediction of a run over a real network: the same loop, its packets replayed."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from teleop_drake.channels.network import NetworkChannelConfig
from teleop_drake.channels.trace import WriteTrace
from teleop_drake.figures.runs import PlotRows, SaveFigure
from teleop_drake.figures.selection import SelectRows
from teleop_drake.files import WriteText
from teleop_drake.link.side import WAYS, Half, Side
from teleop_drake.recording import Recording
from teleop_drake.scenario import ScenarioToYaml
from teleop_drake.stations import ResolveController


def SaveRun(side: Side, folder: Path, **own: Any) -> dict[str, Any]:
    """Writes what a side has recorded, predicts it, and returns its report.

    It writes <side>.npz, a trace for each direction, <side>_forward.csv and
    <side>_return.csv, the scenario with these as channels, <side>_predicted.yaml, and
    <side>_prediction.png. In the traces no delay is negative.

    Args:
        own: Systems of one's own, such as the sides had.
    """
    recording, controller = side.Recording(), side.scenario.controller
    recording.Save(folder / f"{side.side}.npz")
    changes: dict[str, Any] = {"duration": float(recording.time[-1])}
    for way, delays in side.Delays().items():
        trace = folder / f"{side.side}_{way}.csv"
        WriteTrace(trace, side.period, delays.clip(0))
        fields: Any = {"delay": 0.0, "sample_period": side.period, "trace_end": "hold"}
        changes[f"{way}_channel"] = NetworkChannelConfig(trace=trace.name, **fields)
    if hasattr(controller, kind := controller.kind):
        # Gains are those of the run, not what these channels would give.
        gains = {kind: ResolveController(side.scenario)}
        changes["controller"] = dataclasses.replace(controller, **gains)
    text = ScenarioToYaml(dataclasses.replace(side.scenario, **changes))
    WriteText(folder / f"{side.side}_predicted.yaml", text)
    report = side.Report()
    try:
        predicted = Predict(side, **own)
    except ArithmeticError as error:  # It diverges.
        side.Say(f"no prediction: {error}")
    else:
        picture = folder / f"{side.side}_prediction.png"
        report["prediction"] = Compare(recording, predicted, picture)
    return report


def Predict(side: Side, **own: Any) -> Recording:
    """Simulates both sides at each tick, from what they had in use.

    Returns:
        The signals of both sides at the times of the side's recording.
    """
    ticks, used = np.arange(side.tick + 1), side.Used()
    halves = [Half(side.scenario, x, side.period, side.fade, own) for x in WAYS]
    sent = {half.spoken: half.sent for half in halves}
    # The other side's turns follow from these, but for those that it missed.
    rows = side.used[side.spoken][: ticks.size]
    known = np.append(np.flatnonzero(rows > -2), ticks[-1])
    is_missed = rows[known[np.searchsorted(known, ticks)]] == -1
    echoes = used[side.heard][used[side.spoken].clip(0)].clip(0)
    is_stale = (ticks - echoes) * side.period > side.limit
    turns = dict.fromkeys(WAYS, np.where(is_stale, 1, -1) * ~is_missed)
    at, turn, *_ = np.transpose(side.log[1:]).astype(int)
    turns[side.side] = np.bincount(at, turn, ticks.size).astype(int)

    def Order(half: Half) -> tuple[int, int]:
        """Returns how many packets a half would have to wait for, and its tick."""
        k = len(half.sent) - 1
        return max(used[half.heard][k] + 2 - len(sent[half.heard]), 0), k

    # As it happened: a packet is there before it is in use, whatever the clocks say.
    while left := [half for half in halves if len(half.sent) <= ticks.size]:
        half = min(left, key=Order)
        k, heard = len(half.sent) - 1, sent[half.heard]
        packet = heard[: used[half.heard][k] + 2][-1]
        half.Step(k * side.period, packet, turns[half.side][k])
    signals = halves[0].Signals(ticks.size) | halves[1].Signals(ticks.size)
    predicted = {name: x[at] for name, x in signals.items()}
    return dataclasses.replace(side.Recording(), signals=predicted)


def Compare(run: Recording, expected: Recording, file: Any = None) -> dict[str, float]:
    """Returns how far the packets of a run and of its prediction differ.

    That is the largest difference as a share of the largest value, by the signal.

    Args:
        file: Where to draw both; None: nowhere.
    """
    differences = {}
    for name in [x for x in run if "_packet_" in x]:
        size = np.abs(expected[name]).max(axis=0).clip(1e-9)
        differences[name] = float((np.abs(run[name] - expected[name]) / size).max())
    if file is not None:
        # A figure wants to know where the tool is, which the operator's side does not.
        measured = dataclasses.replace(run, signals=expected.signals | run.signals)
        runs = {"measured": measured, "predicted": expected}
        rows = SelectRows([], list(runs.values()), list(differences))
        SaveFigure(PlotRows(runs, rows, columns=1), file)
    return differences
