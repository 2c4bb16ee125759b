"""Predicts a run over a real network: simulates the loop with the packets in use."""

import dataclasses
from pathlib import Path

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.loops.framework.files import WriteText
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.model.channels.trace import WriteTrace
from teleop_drake.model.scenario import Scenario, ScenarioToYaml
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.task_recording import TaskRecording
from teleop_drake.study.figures.runs import PlotRows, SaveFigure
from teleop_drake.study.figures.selection import SelectRows
from teleop_drake.study.link.half import WAYS, Half, Turn
from teleop_drake.study.link.side import Side


def SaveRun(side: Side, folder: Path) -> Record:
    """Writes the recording of a side and its prediction; returns the side's report.

    The files are

    * <side>.npz: the recording;
    * <side>_forward.csv and <side>_return.csv: the delays as traces, 0 if negative;
    * <side>_predicted.yaml: the scenario with the traces as its channels;
    * <side>_prediction.png: the packets as measured and as predicted, unless the
      prediction diverges.
    """
    recording = side.Recording()
    recording.Save(folder / f"{side.side}.npz")
    traces = {}
    for way, delays in side.measured.Delays().items():
        trace = folder / f"{side.side}_{way}.csv"
        WriteTrace(trace, np.arange(len(delays)) * side.period, delays.clip(0))
        traces[way] = trace.name
    scenario = _WithTraces(side, traces, float(recording.time[-1]))
    WriteText(folder / f"{side.side}_predicted.yaml", ScenarioToYaml(scenario))
    report = side.Report()
    try:
        predicted = Predict(side)
    except ArithmeticError as error:  # The prediction diverges.
        side.Say(f"no prediction: {error}")
        return report
    picture = folder / f"{side.side}_prediction.png"
    report["prediction"] = Compare(recording, predicted, picture)
    return report


def _WithTraces(side: Side, traces: dict[str, str], duration: float) -> Scenario:
    """Returns the scenario with the recorded channels, and the gains of the run."""
    changes: Record = {"duration": duration}
    for way, trace in traces.items():
        changes[f"{way}_channel"] = NetworkChannelConfig(
            delay=0.0, sample_period=side.period, trace=trace, trace_end="hold"
        )
    controller = side.scenario.controller
    if hasattr(controller, controller.kind):
        # Otherwise gains that depend on channels would differ from those of the run.
        gains = {controller.kind: ResolveController(side.scenario)}
        changes["controller"] = dataclasses.replace(controller, **gains)
    return dataclasses.replace(side.scenario, **changes)


def Predict(side: Side) -> TaskRecording:
    """Simulates both sides at each tick with the packets that they had in use.

    Returns:
        The signals of both sides at the times of the side's recording.

    Raises:
        ArithmeticError: If a side diverges.
    """
    num_ticks = side.measured.last_tick + 1
    used = side.measured.Used()
    turns = _Turns(side, used)
    halves = [Half(side.scenario, name, side.period, side.fade) for name in WAYS]
    sent = {half.spoken: half.sent for half in halves}

    def NextTick(half: Half) -> int:
        return len(half.sent) - 1

    def Order(half: Half) -> tuple[int, int]:
        """Returns the number of packets that a half waits for, and its next tick."""
        tick = NextTick(half)
        num_needed = used[half.heard][tick] + 2
        return max(num_needed - len(sent[half.heard]), 0), tick

    # The half that waits for the fewest packets is next. Thus packets are sent before
    # they are in use, even if clocks have drifted.
    for _ in range(len(halves) * num_ticks):
        half = min((x for x in halves if NextTick(x) < num_ticks), key=Order)
        tick = NextTick(half)
        packets = sent[half.heard]
        # packets[0] is the initial packet, and packets[k + 1] the packet of tick k.
        newest = min(used[half.heard][tick] + 1, len(packets) - 1)
        half.Step(tick * side.period, packets[newest], turns[half.side][tick])
    signals = halves[0].Signals(num_ticks) | halves[1].Signals(num_ticks)
    recorded = [tick.tick for tick in side.measured.ticks]
    predicted = {name: x[recorded] for name, x in signals.items()}
    return dataclasses.replace(side.Recording(), signals=predicted)


def _Turns(side: Side, used: dict[str, Array]) -> dict[str, list[Turn]]:
    """Returns the change of trust at each tick, for both sides.

    The changes of the given side were recorded. The changes of the other side follow
    from the packets that it had in use, except at the ticks that it missed.
    """
    num_ticks = side.measured.last_tick + 1
    own = [Turn.MISSED] * num_ticks
    for measured in side.measured.ticks:
        own[measured.tick] = Turn.FALLS if measured.is_stale else Turn.COMES_BACK
    ticks = np.arange(num_ticks)
    # An unknown tick counts as missed if the next known tick was missed.
    rows = side.measured.used[side.spoken][:num_ticks]
    known = np.append(np.flatnonzero(rows > -2), num_ticks - 1)
    next_known = known[np.searchsorted(known, ticks)]
    is_missed = rows[next_known] == -1
    # The tick of the echo in the packet that the other side had in use.
    heard = used[side.spoken].clip(0)
    echoes = used[side.heard][heard].clip(0)
    is_stale = (ticks - echoes) * side.period > side.limit
    turns = np.where(is_stale, Turn.FALLS, Turn.COMES_BACK)
    turns[is_missed] = Turn.MISSED
    (other,) = set(WAYS) - {side.side}
    return {side.side: own, other: [Turn(x) for x in turns]}


def Compare(
    run: TaskRecording, expected: TaskRecording, file: Path | None = None
) -> dict[str, float]:
    """Returns the difference between the packets of a run and of its prediction.

    For each signal, it is the largest difference of a component, as a share of the
    component's largest predicted magnitude.

    Args:
        run: The recording of the run.
        expected: The prediction.
        file: The file for a picture of both; None: no picture.
    """
    differences = {}
    for name in run:
        if "_packet_" not in name:
            continue
        size = np.abs(expected[name]).max(axis=0).clip(1e-9)
        shares = np.abs(run[name] - expected[name]) / size
        differences[name] = float(shares.max())
    if file is not None:
        # A figure needs the tool's position, which the operator's side does not record.
        measured = dataclasses.replace(run, signals=expected.signals | run.signals)
        runs = {"measured": measured, "predicted": expected}
        rows = SelectRows([], list(runs.values()), list(differences))
        SaveFigure(PlotRows(runs, rows, columns=1), file)
    return differences
