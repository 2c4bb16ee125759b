"""The prediction of a run over a real network: the same loop, its packets replayed."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.blocks.channels.network import NetworkChannelConfig
from teleop_drake.blocks.channels.trace import WriteTrace
from teleop_drake.figures.runs import PlotRows, SaveFigure
from teleop_drake.figures.selection import SelectRows
from teleop_drake.files import WriteText
from teleop_drake.link.half import WAYS, Half, Turn
from teleop_drake.link.side import Side
from teleop_drake.recording import Recording
from teleop_drake.scenario import Scenario, ScenarioToYaml
from teleop_drake.stations import ResolveController


def SaveRun(side: Side, folder: Path) -> dict[str, Any]:
    """Writes what a side has recorded, predicts it, and returns its report.

    It writes <side>.npz, a trace for each direction, <side>_forward.csv and
    <side>_return.csv, the scenario with these as channels, <side>_predicted.yaml, and
    <side>_prediction.png. In the traces no delay is negative.
    """
    recording = side.Recording()
    recording.Save(folder / f"{side.side}.npz")
    traces = {}
    for way, delays in side.measured.Delays().items():
        trace = folder / f"{side.side}_{way}.csv"
        WriteTrace(trace, side.period, delays.clip(0))
        traces[way] = trace.name
    scenario = _WithTraces(side, traces, float(recording.time[-1]))
    WriteText(folder / f"{side.side}_predicted.yaml", ScenarioToYaml(scenario))
    report = side.Report()
    try:
        predicted = Predict(side)
    except ArithmeticError as error:  # It diverges.
        side.Say(f"no prediction: {error}")
        return report
    picture = folder / f"{side.side}_prediction.png"
    report["prediction"] = Compare(recording, predicted, picture)
    return report


def _WithTraces(side: Side, traces: dict[str, str], duration: float) -> Scenario:
    """Returns the scenario with the recorded channels, and the gains of the run."""
    changes: dict[str, Any] = {"duration": duration}
    for way, trace in traces.items():
        changes[f"{way}_channel"] = NetworkChannelConfig(
            delay=0.0, sample_period=side.period, trace=trace, trace_end="hold"
        )
    controller = side.scenario.controller
    if hasattr(controller, controller.kind):
        # Not the gains that these channels would give.
        gains = {controller.kind: ResolveController(side.scenario)}
        changes["controller"] = dataclasses.replace(controller, **gains)
    return dataclasses.replace(side.scenario, **changes)


def Predict(side: Side) -> Recording:
    """Simulates both sides at each tick, from what they had in use.

    Returns:
        The signals of both sides at the times of the side's recording.
    """
    num_ticks = side.measured.last_tick + 1
    used = side.measured.Used()
    turns = _Turns(side, used)
    halves = [Half(side.scenario, name, side.period, side.fade) for name in WAYS]
    sent = {half.spoken: half.sent for half in halves}

    def NextTick(half: Half) -> int:
        return len(half.sent) - 1

    def Order(half: Half) -> tuple[int, int]:
        """Returns how many packets a half would have to wait for, and its tick."""
        tick = NextTick(half)
        num_needed = used[half.heard][tick] + 2
        return max(num_needed - len(sent[half.heard]), 0), tick

    # As it happened: a packet is there before it is in use, whatever the clocks say.
    for _ in range(len(halves) * num_ticks):
        half = min((x for x in halves if NextTick(x) < num_ticks), key=Order)
        tick = NextTick(half)
        packets = sent[half.heard]
        # The first one is the architecture's, that of tick 0 is the second.
        newest = min(used[half.heard][tick] + 1, len(packets) - 1)
        half.Step(tick * side.period, packets[newest], turns[half.side][tick])
    signals = halves[0].Signals(num_ticks) | halves[1].Signals(num_ticks)
    recorded = [tick.tick for tick in side.measured.ticks]
    predicted = {name: x[recorded] for name, x in signals.items()}
    return dataclasses.replace(side.Recording(), signals=predicted)


def _Turns(side: Side, used: dict[str, Array]) -> dict[str, list[Turn]]:
    """Returns what trust did at each tick, by the side.

    The turns of the side itself were recorded. Those of the other side follow from what
    it had in use, but for the ticks that it missed.
    """
    num_ticks = side.measured.last_tick + 1
    own = [Turn.MISSED] * num_ticks
    for measured in side.measured.ticks:
        own[measured.tick] = Turn.FALLS if measured.is_stale else Turn.COMES_BACK
    ticks = np.arange(num_ticks)
    # Where it is not known, a tick was missed if the next known one was.
    rows = side.measured.used[side.spoken][:num_ticks]
    known = np.append(np.flatnonzero(rows > -2), num_ticks - 1)
    next_known = known[np.searchsorted(known, ticks)]
    is_missed = rows[next_known] == -1
    # The tick of the echo in what it had in use.
    heard = used[side.spoken].clip(0)
    echoes = used[side.heard][heard].clip(0)
    is_stale = (ticks - echoes) * side.period > side.limit
    turns = np.where(is_stale, Turn.FALLS, Turn.COMES_BACK)
    turns[is_missed] = Turn.MISSED
    (other,) = set(WAYS) - {side.side}
    return {side.side: own, other: [Turn(x) for x in turns]}


def Compare(
    run: Recording, expected: Recording, file: Path | None = None
) -> dict[str, float]:
    """Returns how far the packets of a run and of its prediction differ.

    That is the largest difference as a share of the largest value, by the signal.

    Args:
        file: Where to draw both; None: nowhere.
    """
    differences = {}
    for name in run:
        if "_packet_" not in name:
            continue
        size = np.abs(expected[name]).max(axis=0).clip(1e-9)
        shares = np.abs(run[name] - expected[name]) / size
        differences[name] = float(shares.max())
    if file is not None:
        # A figure wants to know where the tool is, which the operator's side does not.
        measured = dataclasses.replace(run, signals=expected.signals | run.signals)
        runs = {"measured": measured, "predicted": expected}
        rows = SelectRows([], list(runs.values()), list(differences))
        SaveFigure(PlotRows(runs, rows, columns=1), file)
    return differences
