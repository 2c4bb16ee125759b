"""The prediction of a run over a real network: the same loop, its packets replayed."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from teleop_drake.channels.network import NetworkChannelConfig
from teleop_drake.figures.runs import PlotRows, SaveFigure
from teleop_drake.files import Replacing
from teleop_drake.link.packets import Array
from teleop_drake.link.side import Side
from teleop_drake.recording import Recording
from teleop_drake.scenario import ScenarioToYaml
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.panels import SignalRow
from teleop_drake.teleoperator import MakeTeleoperator

# Share of a signal's range, and how much at least, within which values are the same.
_SAME, _LEAST = 1e-3, 1e-9

# What arrives at an instant is not in its row yet, s.
_INSTANT = 1e-9


def SaveRun(side: Side, folder: Path) -> list[Path]:
    """Writes what a side has recorded, and returns the files.

    They are <side>.npz, a trace for each direction, <side>_forward.csv and
    <side>_return.csv, and the scenario with these as channels, <side>_predicted.yaml.
    """
    recording, channels = side.Recording(), {}
    files = [folder / f"{side.side}.npz"]
    recording.Save(files[0])
    for way, delays in side.Delays().items():
        files.append(folder / f"{side.side}_{way}.csv")
        rows = [f"{k * side.period:.9g},{x:.9g}\n" for k, x in enumerate(delays)]
        _Write(files[-1], "time,delay\n" + "".join(rows))
        channels[f"{way}_channel"] = _Channel(side, files[-1].name)
    files.append(folder / f"{side.side}_predicted.yaml")
    changes: dict[str, Any] = {"duration": float(recording.time[-1]), **channels}
    controller = side.scenario.controller
    if hasattr(controller, kind := controller.kind):
        # Gains are those of the run, not what these channels would give.
        gains = {kind: ResolveController(side.scenario)}
        changes["controller"] = dataclasses.replace(controller, **gains)
    _Write(files[-1], ScenarioToYaml(dataclasses.replace(side.scenario, **changes)))
    return files


def _Write(file: Path, text: str) -> None:
    with Replacing(file) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _Channel(side: Side, trace: str) -> NetworkChannelConfig:
    return NetworkChannelConfig(
        delay=0.0, sample_period=side.period, trace=trace, trace_end="hold"
    )


def Predict(side: Side, folder: Path, **own: Any) -> Recording:
    """Simulates the whole loop with the traces that SaveRun() has written.

    Args:
        own: Systems of one's own, such as the sides had.
    """
    duration = float(side.Recording().time[-1])
    for way, initial in side.initial.items():
        channel = _Channel(side, str(folder / f"{side.side}_{way}.csv"))
        own[f"{way}_channel"] = channel.MakeChannel(
            size=initial.size, initial_value=initial.tolist(), duration=duration
        )
    diagram = MakeTeleoperator(side.scenario, **own)
    return simulate(side.scenario, duration=duration, teleoperator=diagram)


def Compare(side: Side, predicted: Recording, picture: Path) -> dict[str, float]:
    """Draws the packets of a run and their prediction; returns how far they differ.

    Returns:
        By the signal a time in s: each value is among those that were predicted within
        it, to a thousandth of the signal's range.
    """
    recording, differences, rows = side.Recording(), {}, []
    for name in [x for x in recording if "_packet_" in x]:
        values = predicted.Interpolate(name, recording.time - _INSTANT)
        # At the very start nobody has heard anything.
        apart = _SamplesApart(recording[name][1:], values[1:])
        differences[name] = side.period * apart
        rows += [
            SignalRow(
                label="{}\n{} {} [{}]".format(*name.split("_"), k),
                unit="",
                signal=name,
                components=[k],
            )
            for k in range(values.shape[1])
        ]
    # A figure wants to know where the tool is.
    tool = predicted.Interpolate("tool_position", recording.time)
    signals = {"tool_position": tool} | recording.signals
    runs = {
        "measured": dataclasses.replace(recording, signals=signals),
        "predicted": predicted,
    }
    SaveFigure(PlotRows(runs, rows, columns=1), picture)
    return differences


def _SamplesApart(measured: Array, predicted: Array) -> int:
    """Returns a power of 2: among so many samples around its own each value is found.

    0: at its own.
    """
    slack, num = _SAME * np.ptp(predicted, axis=0) + _LEAST, 0
    while num < len(predicted):
        size = 2 * num + 1
        low = minimum_filter1d(predicted, size, axis=0, mode="nearest") - slack
        high = maximum_filter1d(predicted, size, axis=0, mode="nearest") + slack
        if np.all((measured >= low) & (measured <= high)):
            break
        num = max(2 * num, 1)
    return num
