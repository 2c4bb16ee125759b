"""Diagrams with a delay that is a signal, and their closed forms."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from scipy.optimize import brentq

from teleop_drake.loops import VariableDelay, VariableTransportDelay
from teleop_drake.loops.kernel import FixedBlock, Kernel, Transition


def Source(function, size=1):
    """Returns a block whose output `y` is a function of time."""
    outputs = {"y": (function, "time")}
    return FixedBlock("", Kernel(outputs=outputs), inputs={}, outputs={"y": size})


def opposite(mode):
    return -mode


def Square(period, values=(-1.0, 1.0)):
    """Returns a block whose output `y` jumps between two values, by events."""
    low, high = values
    kernel = Kernel(
        parameters={"mean": np.array([(low + high) / 2]), "half": (high - low) / 2},
        outputs={"y": (_scaled, "mean", "half", "mode")},
        transitions={
            "flip": Transition(
                mode=(opposite, "mode"), period=period / 2, offset=period / 2
            )
        },
    )
    return FixedBlock("", kernel, inputs={}, outputs={"y": 1}, mode=[1.0])


def _scaled(mean, half, mode):
    return mean + half * mode


def Delayed(signal, steering, delay):
    """Returns a Diagram of a delay; its outputs are `sent`, `steering`, `out`."""
    builder = DiagramBuilder()
    blocks = {"sent": signal, "steering": steering, "out": delay}
    for name, block in blocks.items():
        builder.AddNamedSystem(name, block)
        builder.ExportOutput(block.get_output_port(), name)
    for i, name in enumerate(("sent", "steering")):
        port = blocks[name].get_output_port()
        builder.Connect(port, delay.get_input_port(i))
    return builder.Build()


def TimeDelay(signal, steering, maximum_delay=10.0, **options):
    """Returns a Diagram of a VariableDelay."""
    delay = VariableDelay(size=1, maximum_delay=maximum_delay, **options)
    return Delayed(signal, steering, delay)


def Conveyor(signal, velocity, length, **options):
    """Returns a Diagram of a VariableTransportDelay."""
    delay = VariableTransportDelay(length=length, size=1, **options)
    return Delayed(signal, velocity, delay)


def Loop(rate, delay, start, **options):
    """Returns a Diagram of x' = rate(t, x(t - T)), T = delay(t, x); and its Context.

    The outputs are x and T.

    Args:
        start: The time and x at the start, which x had before, too.
        options: Arguments of VariableDelay.
    """
    kernel = Kernel(
        outputs={"x": "state", "T": (delay, "time", "state")},
        rate=(rate, "time", "late"),
    )
    time, x = start
    plant = FixedBlock(
        "", kernel, inputs={"late": 1}, outputs={"x": 1, "T": 1}, state=[x]
    )
    line = VariableDelay(size=1, initial_value=[x], **options)
    builder = DiagramBuilder()
    for name, block in {"plant": plant, "line": line}.items():
        builder.AddNamedSystem(name, block)
    for source, port in (("x", "signal"), ("T", "delay")):
        builder.Connect(plant.GetOutputPort(source), line.GetInputPort(port))
        builder.ExportOutput(plant.GetOutputPort(source), source)
    builder.Connect(line.get_output_port(), plant.get_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    context.SetTime(time)
    return diagram, context


def Roots(function, begin, end, number=6001):
    """Returns the roots of a function that changes its sign there."""
    times = np.linspace(begin, end, number)
    values = function(times)
    places = np.flatnonzero(values[1:] * values[:-1] < 0)
    return [brentq(function, times[i], times[i + 1], xtol=1e-14) for i in places]


def Entered(distance, length, times, number=40001):
    """Returns when what leaves a conveyor at some times has entered; nan: never.

    Args:
        distance: The travelled distance, a function of time that takes arrays.
    """
    grid = np.linspace(0.0, times[-1], number)
    path = distance(grid)
    entered = []
    for time in times:
        level = distance(time) - length
        rising = np.flatnonzero(
            (path[:-1] <= level) & (level < path[1:]) & (grid[:-1] < time)
        )
        if len(rising) == 0:
            entered.append(np.nan)
            continue
        begin, end = grid[rising[-1] : rising[-1] + 2]
        entered.append(
            brentq(lambda s, c=level: distance(s) - c, begin, end, xtol=1e-14)
        )
    return np.array(entered)
