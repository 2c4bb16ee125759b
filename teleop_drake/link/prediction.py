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
from teleop_drake.link.side import Parts, Side
from teleop_drake.recording import Recording
from teleop_drake.scenario import LoadScenario, ScenarioToYaml
from teleop_drake.signals import AxisUnit
from teleop_drake.simulation import simulate
from teleop_drake.stations import ResolveController
from teleop_drake.tasks.panels import SignalRow
from teleop_drake.teleoperator import MakeTeleoperator

# Share of a signal's range, and how much at least, within which values are the same.
_SAME, _LEAST = 1e-3, 1e-9

# What arrives at an instant is not in its row yet, s.
_INSTANT = 1e-9

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
    recording.Save(folder / f"{side.side}.npz")
    files = [folder / f"{side.side}.npz"]
    changes: dict[str, Any] = {"duration": float(recording.time[-1])}
    for way, delays in side.Delays().items():
        files.append(folder / f"{side.side}_{way}.csv")
        delays = np.maximum(delays, 0)
        rows = [f"{k * side.period:.9g},{x:.9g}\n" for k, x in enumerate(delays)]
        _Write(files[-1], "time,delay\n" + "".join(rows))
        changes[f"{way}_channel"] = NetworkChannelConfig(
            delay=0.0,
            sample_period=side.period,
            trace=files[-1].name,
            trace_end="hold",
        )
    if hasattr(controller, kind := controller.kind):
        # Gains are those of the run, not what these channels would give.
        gains = {kind: ResolveController(side.scenario)}
        changes["controller"] = dataclasses.replace(controller, **gains)
    files.append(folder / f"{side.side}_predicted.yaml")
    _Write(files[-1], ScenarioToYaml(dataclasses.replace(side.scenario, **changes)))
    return files


def _Write(file: Path, text: str) -> None:
    with Replacing(file) as temporary:
        temporary.write_text(text, encoding="utf-8")


def Predict(side: Side, folder: Path, **own: Any) -> Recording:
    """Simulates the whole loop as SaveRun() has written it.

    Args:
        own: Systems of one's own, such as the sides had.
    """
    scenario = LoadScenario(folder / f"{side.side}_predicted.yaml")
    return simulate(scenario, teleoperator=MakeTeleoperator(scenario, **own))


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
        way, _, event = name.partition("_packet_")
        rows += [
            SignalRow(
                label=f"{part} {axis}\n{event}",
                unit=AxisUnit(_UNITS.get(part[0], ""), axis),
                signal=name,
                components=[k],
            )
            for k, (part, axis) in enumerate(Parts(side.scenario, way))
            if k < values.shape[1]
        ]
    # A figure wants to know where the tool is.
    tool = predicted.Interpolate("tool_position", recording.time)
    signals = {"tool_position": tool} | recording.signals
    measured = dataclasses.replace(recording, signals=signals)
    runs = {"measured": measured, "predicted": predicted}
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
