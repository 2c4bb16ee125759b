"""What a task measures of a run, as data; measuring.py measures it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.integrator.measuring import NUM_INSTANTS, Record, Rows, measure
from teleop_drake.integrator.problem import ROWS
from teleop_drake.machine_code.typed_code import CompileTyped
from teleop_drake.machine_code.typed_expressions import TypeOf
from teleop_drake.numerics.step_polynomials import DEGREE, lagrange, shares
from teleop_drake.recording import Event, Recording
from teleop_drake.signals import AxesOf, AxisUnit

# Begin and size in a row of each signal, and its unit.
Places = Mapping[str, tuple[int, int, str]]

# What a form has behind the weights of columns: that of 1, and what Record says.
_MORE = 5


@dataclass(kw_only=True)
class Measures:
    """What is measured.

    Attributes:
        columns: Of the rows that are watched.
        late: Those that are watched as they were the delay of the command ago.
        mode: The column of the operator's mode, -1 without.
        forms: The weights (C + 5) of each; see Record.
        events: What it is called where one of the first forms crosses 0 upwards and
            downwards, "" without a name.
        names: Of the measures, with their labels.
        table: The measures; see Record.
    """

    columns: list[int] = field(default_factory=list)
    late: list[int] = field(default_factory=list)
    mode: int = -1
    forms: list[Array] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    names: dict[str, str] = field(default_factory=dict)
    table: list[list[int]] = field(default_factory=list)

    def Watch(self, *places: tuple[int, int, str], late: bool = False) -> None:
        """Watches the columns of some signals."""
        columns = self.late if late else self.columns
        columns += [i for begin, size, _ in places for i in range(begin, begin + size)]

    def Vectors(self, num_axes: int) -> Array:
        """Returns the forms (k, n, C + 5) of the k vectors that are watched."""
        size = len(self.columns) + len(self.late)
        return np.eye(size, size + _MORE).reshape(-1, num_axes, size + _MORE)

    def One(self, place: int = 0) -> Array:
        """Returns the form that is 1, or what stands at a place behind that."""
        size = len(self.columns) + len(self.late)
        return np.eye(1, size + _MORE, size + place)[0]

    def AddEvent(self, form: Array, upwards: str = "", downwards: str = "") -> None:
        """Adds a form that is an event where it crosses 0, before all measures."""
        self.forms.append(form)
        self.events += upwards, downwards

    def EventNames(self) -> list[str]:
        """Returns the names of events by their numbers."""
        return [*self.events, "surgeon_force", "surgeon_stop"]

    def Add(
        self,
        task: Any,
        name: str,
        operation: int,
        forms: Sequence[Array] = (),
        begin: str = "",
        ends: Sequence[str] = (),
    ) -> None:
        """Adds a measure from an event on, or of the run, until the first of others."""
        whole, _, axis = name.rpartition(".")
        unit = AxisUnit(task.units.get(name) or task.units.get(f"{whole}.*", ""), axis)
        label = name.replace("_", " ").replace(".", ": ")
        self.names[name] = f"{label} [{unit}]" if unit else label
        first, known = len(self.forms), self.EventNames()
        places = [
            known.index(x) if x and x in known else -1 for x in (begin, *ends, "", "")
        ]
        self.forms += forms
        self.table.append([operation, first, len(self.forms), *places[:3]])

    def AddPerAxis(self, task: Any, name: str, operation: int, *forms: Array) -> None:
        """Adds a measure of the whole run for each axis, of one form or several."""
        for axis, *own in zip(AxesOf(len(forms[0])), *forms, strict=True):
            self.Add(task, f"{name}.{axis}", operation, own)

    def Record(self, num_rows: int, delay: float) -> Record:
        """Returns what measure() takes for as many rows and a delay of the command."""
        num, c = len(self.forms), len(self.columns) + len(self.late)
        room = num_rows + 1024
        numbers = len(self.columns), len(self.events) // 2, self.mode, 0
        return Record(
            delay=np.array([delay]),
            places=np.array(numbers),
            columns=np.array([*self.columns, *self.late], np.int64),
            forms=np.array(self.forms, float).reshape(num, c + _MORE),
            table=np.array(self.table, np.int64).reshape(-1, 6),
            counts=np.zeros(3, np.int64),
            instants=np.zeros((room, 2)),
            pieces=np.zeros((room, 3)),
            piece_rows=np.zeros(room, np.int64),
            ends=np.zeros(room, np.int64),
            weights=np.zeros(DEGREE + 1),
            values=np.zeros((num, DEGREE + 1)),
            powers=np.zeros((num, DEGREE + 1)),
            slope=np.zeros(DEGREE),
            trace=np.zeros(DEGREE + 2),
            around=np.zeros((num, 3)),
            results=np.zeros(len(self.table)),
        )

    def Of(
        self, recording: Recording, delay: float
    ) -> tuple[list[Event], dict[str, Any]]:
        """Returns the events and the measures of a recording.

        Args:
            recording: Its signals are those of PlacesOf().
            delay: Of the command, s.

        Returns:
            A list with an entry for each axis, or a dict for each event, of numbers;
            None where there is none.
        """
        time, steps = recording.time, recording.steps
        if len(steps) == 0:
            steps = np.full((1, DEGREE + 1), len(time) - 1)
        weights = lagrange(shares(DEGREE), steps.shape[1] - 1)

        def InSteps(x: Array) -> Array:
            return np.concatenate([x[:1], (weights @ x[steps]).reshape(-1, x.shape[1])])

        used = sorted({*self.columns, *self.late, max(self.mode, 0)})
        every = [x[:, k] for x in recording.signals.values() for k in range(x.shape[1])]
        rows = InSteps(np.stack([time, *(every[k] for k in used)], axis=1))
        ends = np.zeros(len(rows), np.int64)
        ends[DEGREE + 1 :: DEGREE + 1] = 1
        counts = np.zeros(ROWS + 1, np.int64)
        counts[ROWS] = len(rows)
        record = self.Record(len(rows), delay)
        record.columns[:] = [used.index(k) for k in (*self.columns, *self.late)]
        record.places[3] = recording.termination == "diverged"
        record.places[2] = used.index(self.mode) if self.mode >= 0 else -1
        measured = Rows(counts, rows[:, 0].copy(), ends, rows[:, 1:].copy())
        types = tuple(map(TypeOf, (record, measured)))
        CompileTyped(measure, types)(record, measured)
        names = self.EventNames()
        instants = record.instants[: record.counts[NUM_INSTANTS]].tolist()
        events = [
            Event(name=names[int(i)], time=t)
            for t, i in instants
            if i >= 0 and names[int(i)]
        ]
        results: dict[str, Any] = {}
        for name, x in zip(self.names, record.results.tolist(), strict=True):
            whole, _, part = name.rpartition(".")
            group = results.setdefault(whole, {}) if whole else results
            group[part] = None if math.isnan(x) else x
        return events, results


def PlacesOf(recording: Recording) -> Places:
    """Returns where the signals of a recording are if they stand side by side."""
    places, begin = {}, 0
    for name, x in recording.signals.items():
        places[name] = begin, x.shape[1], ""
        begin += x.shape[1]
    return places
