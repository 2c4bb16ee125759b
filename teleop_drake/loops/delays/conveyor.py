"""A variable transport delay: what enters at one end leaves when it has travelled."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import Demultiplexer

from teleop_drake.loops.delays.base import CheckedInterval, CheckSize
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import CheckNumber, Refuse
from teleop_drake.loops.framework.wiring import Wire
from teleop_drake.loops.kernel import Delay, FixedBlock, Kernel, Transition

# A conveyor stands when its speed is less than this share of its length per second.
_STANDING = 1e-9


class VariableTransportDelay(Diagram):
    """Delays a vector signal by the time of travel on a conveyor or in a pipe.

        delayed_signal(t) = signal(s),     integral of v from s to t = length
                          = initial_value  for what was there at the start

    with the input `velocity`, v. What enters at one end leaves at the other when the
    conveyor has moved by its length; while it stands, so does the output. The delay
    t - s results from the velocity of all the time between, whereas the T of a
    VariableDelay is that of the moment of arrival.

    The conveyor may go backwards. What has left then comes back to the output, and what
    goes out at the entry is lost: s is the last time at which the travelled distance
    was less by `length`.

    | port | name           | size | unit           |
    |------|----------------|------|----------------|
    | in   | signal         | size | any            |
    | in   | velocity       | 1    | of length, 1/s |
    | out  | delayed_signal | size | of signal      |

    State: the travelled distance (1), the direction (1), and a SteeredLine.

    Initial value: `initial_value` is delivered until what has entered arrives.

    Direct feedthrough: from `signal`, in Drake's Simulator; see VariableDelay.

    Steps: those of VariableDelay.

    It has no numeric parameters: another length is another block.

    Args:
        length: The length of the conveyor, > 0, in any unit.
        size: Width of the signal, >= 1.
        initial_value: The output before something arrives (size); zeros if None.
        max_sample_interval: Longest time between two samples in Drake's Simulator, s.
            None: 0.01 s.

    Raises:
        ValueError: If a parameter is outside its range.
    """

    def __init__(
        self,
        length: float,
        size: int = 1,
        initial_value: Sequence[float] | None = None,
        *,
        max_sample_interval: float | None = None,
    ):
        Diagram.__init__(self)
        CheckNumber("length", length, "", above=0)
        CheckSize(size)
        before = [0.0] * size if initial_value is None else list(initial_value)
        if len(before) != size:
            Refuse("initial_value", initial_value, f"{size} numbers or null")
        Wire(
            self,
            "variable_transport_delay",
            {
                "travel": _Travel(length, size),
                "conveyor": _Conveyor(length, before, max_sample_interval),
                "exit": Demultiplexer([size, 2]),
            },
            inputs={"signal": ["travel.signal"], "velocity": ["travel.velocity"]},
            connections={
                "conveyor.line": "travel.line",
                "conveyor.position": "travel.position",
                "exit": "conveyor",
            },
            outputs={"delayed_signal": "exit.y0"},
        )


class _Conveyor(FixedBlock):
    """The delay of a signal, whose last element is the travelled distance."""

    def __init__(
        self, length: float, before: list[float], max_sample_interval: float | None
    ):
        delay = Delay(
            signal="line",
            output="delayed_line",
            initial_value=[*before, 0.0, 0.0],
            time="position",
            length=float(length),
            max_sample_interval=CheckedInterval(max_sample_interval),
        )
        size = len(delay.initial_value)
        FixedBlock.__init__(
            self,
            "",
            Kernel(delays=[delay]),
            inputs={"line": size, "position": 1},
            outputs={"delayed_line": size},
        )


class _Travel(FixedBlock):
    """The travelled distance, with an event where the conveyor stops or starts."""

    def __init__(self, length: float, size: int):
        change = Transition(
            guard=(change_due, "mode", "velocity", "least_speed"),
            mode=(next_direction, "mode", "velocity"),
        )
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters={"least_speed": _STANDING * length},
                # A signal that jumps at each event.
                outputs={"line": ["signal", "mode", "state"], "position": "state"},
                rate="velocity",
                transitions={"change": change},
                initial_mode=(direction_of, "velocity", "least_speed"),
            ),
            inputs={"signal": size, "velocity": 1},
            outputs={"line": size + 2, "position": 1},
            state=[0.0],
            mode=[0.0],
        )


def direction_of(velocity: Array, least_speed: float) -> Array:
    """Returns the direction of a velocity: 1, -1 or, below a least speed, 0 (1)."""
    backward = np.where(velocity < -least_speed, -1.0, 0.0)
    return np.where(velocity > least_speed, 1.0, backward)


def next_direction(direction: Array, velocity: Array) -> Array:
    """Returns the direction after an event: 0, or that of the velocity (1)."""
    return np.where(direction == 0.0, np.where(velocity > 0.0, 1.0, -1.0), 0.0)


def change_due(direction: Array, velocity: Array, least_speed: float) -> Array:
    """Returns a number that is >= 0 when the direction changes (1).

    A conveyor stands below the least speed, and moves again above twice the least.
    """
    leaves = least_speed - direction * velocity
    return np.where(direction == 0.0, np.abs(velocity) - 2 * least_speed, leaves)
