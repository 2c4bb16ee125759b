"""The prediction of a run over a real network: the same loop, its packets replayed."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from teleop_drake.channels.network import NetworkChannelConfig
from teleop_drake.figures.runs import PlotRows, SaveFigure
from teleop_drake.files import Replacing
from teleop_drake.link.halves import WAYS, Half
from teleop_drake.link.packets import NUM_USED
from teleop_drake.link.side import Side
from teleop_drake.recording import Recording
from teleop_drake.scenario import ScenarioToYaml
from teleop_drake.signals import AxisUnit
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.panels import SignalRow

# Units of the parts of packets, by their first letters; u and w are waves.
_UNITS = {"p": "m", "x": "m", "v": "m/s", "a": "m/s^2", "F": "N", "E": "J"}
_UNITS |= dict.fromkeys("uw", "√W")


def SaveRun(side: Side, folder: Path) -> list[Path]:
    """Writes what a side has recorded, and returns the files.

    They are <side>.npz, a trace for each direction, <side>_forward.csv and
    <side>_return.csv, and the scenario with these as channels, <side>_predicted.yaml.
    In the traces no delay is negative.
    """
    recording, controller = side.Recording(), side.scenario.controller
    names = (".npz", "_forward.csv", "_return.csv", "_predicted.yaml")
    files = [folder / f"{side.side}{name}" for name in names]
    recording.Save(files[0])
    changes: dict[str, Any] = {"duration": float(recording.time[-1])}
    for way, delays in side.Delays().items():
        trace = files[1 + (way == "return")]
        rows = np.column_stack((np.arange(len(delays)) * side.period, delays.clip(0)))
        with Replacing(trace) as file:
            np.savetxt(file, rows, "%.9g", ",", header="time,delay", comments="")
        fields: Any = {"delay": 0.0, "sample_period": side.period, "trace_end": "hold"}
        changes[f"{way}_channel"] = NetworkChannelConfig(trace=trace.name, **fields)
    if hasattr(controller, kind := controller.kind):
        # Gains are those of the run, not what these channels would give.
        gains = {kind: ResolveController(side.scenario)}
        changes["controller"] = dataclasses.replace(controller, **gains)
    with Replacing(files[-1]) as file:
        text = ScenarioToYaml(dataclasses.replace(side.scenario, **changes))
        file.write_text(text, encoding="utf-8")
    return files


def Predict(side: Side, **own: Any) -> Recording:
    """Simulates both sides at each tick, from what they had in use.

    Args:
        own: Systems of one's own, such as the sides had.
    """
    ticks, period, sent = np.arange(side.tick + 1), side.period, {}
    halves, used = {}, {}
    for name, (heard, spoken) in WAYS.items():
        halves[name] = Half(side.scenario, name, period, side.num_fading, own)
        sent[spoken] = [halves[name].initial[spoken]]
        # In between of what is known, packets are taken in steady steps.
        rows = side.used[heard][NUM_USED:][: ticks.size]
        known = np.append(-1, np.flatnonzero(rows > -2))
        steps = np.maximum.accumulate(np.append(-1, rows[known[1:]]))
        between = np.interp(ticks, known, steps)
        used[heard] = np.floor(between).astype(int).clip(max=ticks[-1])
    # The other side's turns follow from these, but for those that it missed.
    rows = side.used[side.spoken][NUM_USED:][: ticks.size]
    known = np.append(np.flatnonzero(rows > -2), ticks[-1])
    is_missed = rows[known[np.searchsorted(known, ticks)]] == -1
    echoes = used[side.heard][used[side.spoken].clip(0)].clip(0)
    is_stale = (ticks - echoes) * period > side.limit
    turns = dict.fromkeys(WAYS, np.where(is_stale, 1, -1) * ~is_missed)
    turns[side.side] = side.log["turn"][NUM_USED:]
    done = dict.fromkeys(WAYS, 0)

    def Order(name: str) -> tuple[int, int]:
        """Returns how many packets a side would have to wait for, and its tick."""
        (way, _), k = WAYS[name], done[name]
        return max(used[way][k] + 2 - len(sent[way]), 0), k

    # As it happened: a packet is there before it is in use, whatever the clocks say.
    while halves_left := [x for x in WAYS if done[x] < ticks.size]:
        name = min(halves_left, key=Order)
        half, k, (heard, spoken) = halves[name], done[name], WAYS[name]
        if turn := turns[name][k]:
            place = min(used[heard][k] + 1, len(sent[heard]) - 1)
            half.Follow(sent[heard][place], turn)
        sent[spoken].append(half.Advance(k * period))
        if turn:
            half.Feed()
        done[name] = k + 1
    parts: Any = (ticks * period, {}, "completed", "")
    master, robot = (half.Recording(*parts) for half in halves.values())
    return dataclasses.replace(robot, signals=master.signals | robot.signals)


def Compare(side: Side, predicted: Recording, picture: Path) -> dict[str, float]:
    """Draws the packets of a run and their prediction; returns how far they differ.

    Returns:
        By the signal, the largest difference as a share of the largest value.
    """
    recording, differences, rows = side.Recording(), {}, []
    ticks = np.flatnonzero(side.log["turn"]) - NUM_USED
    for name in [x for x in recording if "_packet_" in x]:
        expected = predicted[name][ticks]
        apart = np.abs(recording[name] - expected)
        size = np.maximum(np.abs(expected).max(axis=0), 1e-9)
        differences[name] = float((apart / size).max())
        for k, part in enumerate(recording.Components(name, size.size)):
            unit = AxisUnit(_UNITS.get(part[0], ""), part.rpartition(" ")[2])
            label = f"{part}\n{name.rpartition('_')[2]}"
            row = SignalRow(label=label, unit=unit, signal=name, components=[k])
            rows.append(row)
    # A figure wants to know where the tool is.
    tool = {"tool_position": predicted["tool_position"][ticks]}
    measured = dataclasses.replace(recording, signals=tool | recording.signals)
    runs = {"measured": measured, "predicted": predicted}
    SaveFigure(PlotRows(runs, rows, columns=1), picture)
    return differences
