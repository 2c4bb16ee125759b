"""The record of a simulation: plain arrays, events and solver statistics."""

import html
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices, Record
from teleop_drake.loops.framework.files import Replacing
from teleop_drake.loops.framework.validation import CheckKind, Choices, Show
from teleop_drake.loops.numerics.step_polynomials import (
    interpolate,
    part,
    straight_steps,
)

if TYPE_CHECKING:
    import pandas

    from teleop_drake.loops.delays.packet_statistics import PacketStatistics

_R = TypeVar("_R", bound="Recording")


class UnknownSignal(KeyError):
    """Raised for an unknown signal name; the message lists the known names."""

    def __str__(self) -> str:
        return str(self.args[0])


FORMAT = 3
"""The format of the files that Recording.Save() writes."""

# Fields that a file stores as arrays.
_ARRAYS = ("time", "steps", "signals")


@dataclass(kw_only=True)
class Event:
    """Something that happened at an instant.

    Attributes:
        name: In the run of a System, `path/system.event`, the name that the system
            gives to an event that it locates. In the run of a scenario: `puncture` (the
            tool leaves the first layer that yields), `heal` (it returns into this
            layer), `contact` and `release` (it reaches and leaves the hard surface),
            `surgeon_force` and `surgeon_stop` (the operator switches to a force, or
            stops).
        time: The time of the event, in s.
    """

    name: str
    time: float


@dataclass(kw_only=True)
class SolverStatistics:
    """The statistics of the solver in one run.

    Attributes:
        engine: The engine: `drake` or `compiled`, see simulation.simulate(); `step` for
            a side of a link whose driver replaces the simulation, see link.side.Side.
        scheme: Integration scheme, by Drake's name.
        accuracy: Target accuracy of the error control.
        steps: Number of steps taken, including the steps of event location.
        derivative_evaluations: Number of evaluations of the time derivatives.
        wall_time_s: Real time spent in s.
        real_time_factor: Simulated time over real time.
    """

    engine: str
    scheme: str
    accuracy: float
    steps: int
    derivative_evaluations: int
    wall_time_s: float
    real_time_factor: float


@dataclass(kw_only=True, repr=False)
class Recording:
    """The recording of a System's run: signals, events and solver statistics.

    That of a scenario's run is a task_recording.TaskRecording.

    Attributes:
        time: (N,) in s: the ends of the integrator's steps, and instants within them. A
            jump has two rows with the same time, the first before it and the second
            after it.
        signals: (N, k) samples by name; see simulation.simulate().
        steps: (S, d + 1) the rows of each step, at equal distances in time. Within a
            step a signal is the polynomial of degree d through these rows; see
            numerics.step_polynomials. By default, signals are straight lines between
            rows.
        events: The events, in the order of their times.
        solver: Solver statistics.
        channels: Statistics of the packets of each channel of kind network, by the name
            of the channel, or by its path in a user's own Diagram.
        termination: `completed`, `terminated` (by an event of a block), `diverged` or
            `interrupted`.
        reason: Why the run did not complete; empty if it did.
        notes: Remarks on the run, for example on what was left out, and why.
        components: The names of the components of signals, as far as a plant or a
            vector of Drake has such names: theta, or shoulder_q.
        final_context: The Context of the System at the end of the run, from which
            simulate() can continue. None for compiled runs of a block with delays
            that is no KernelBlock, for runs of scenarios, and for a recording that
            was read from a file or copied.
    """

    time: Array
    signals: dict[str, Array]
    events: list[Event]
    solver: SolverStatistics
    channels: "dict[str, PacketStatistics]" = field(default_factory=dict)
    termination: str = "completed"
    reason: str = ""
    notes: list[str] = field(default_factory=list)
    components: dict[str, list[str]] = field(default_factory=dict)
    steps: Indices = field(default_factory=lambda: np.empty((0, 0), int))
    # A factory, because a default would be found before __getattr__() is called.
    final_context: Any = field(default_factory=lambda: None)

    # Fields that Save() does not write as JSON.
    _not_plain: ClassVar[tuple[str, ...]] = (*_ARRAYS, "final_context")

    def __post_init__(self) -> None:
        """Sets the default steps: straight lines between rows."""
        if self.steps.shape[1] == 0:
            self.steps = straight_steps(self.time)

    def FindLater(self, finders: Mapping[str, Callable[["Recording"], Any]]) -> None:
        """Defers the computation of fields until they are first read.

        Args:
            finders: The function that computes each field, by the name of the field.
        """
        self.__dict__.setdefault("_finders", {}).update(finders)
        for name in finders:
            delattr(self, name)

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            """Computes a deferred field; see FindLater()."""
            finders = self.__dict__.get("_finders", {})
            if name not in finders:
                raise AttributeError(f"a Recording has no attribute {name!r}")
            value = finders[name](self)
            setattr(self, name, value)
            finders.pop(name, None)  # It keeps the model alive.
            return value

    def __getstate__(self) -> dict[str, Any]:
        """Returns the fields except `final_context`, for pickle and copy."""
        names = {item.name for item in fields(self)} - {"final_context"}
        state = {name: getattr(self, name) for name in names}
        return state | {"final_context": None}  # A Context cannot be pickled.

    def __getitem__(self, name: str) -> Array:
        """Returns the samples (N, k) of a signal.

        Raises:
            UnknownSignal: If there is no signal of that name.
        """
        try:
            return self.signals[name]
        except KeyError:
            raise UnknownSignal(
                f"signal {Show(name)}: must be {Choices(name, self.signals)}"
            ) from None

    def __contains__(self, name: object) -> bool:
        """Returns whether there is a signal of that name."""
        return name in self.signals

    def __iter__(self) -> Iterator[str]:
        """Returns the names of the signals."""
        return iter(self.signals)

    def __repr__(self) -> str:
        """Returns one line with what was run, how it ended and the first events."""
        end = self.time[-1] if len(self.time) else 0
        facts = [f"{end:g} s in {len(self.time)} samples"]
        facts += [f"{len(self.signals)} signals", self.termination]
        facts += [f"{event.name} at {event.time:.4g} s" for event in self.events[:3]]
        if len(self.events) > 3:
            facts.append(f"{len(self.events) - 3} more events")
        return f"<Recording of {self._Subject()}: {', '.join(facts)}>"

    def _Subject(self) -> str:
        """Returns what was run, for the text of the recording."""
        return "a diagram"

    def _repr_html_(self) -> str:
        """Returns the HTML for a notebook: what was run, and the notes."""
        texts = [repr(self), self.reason, *self.notes]
        return "".join(f"<p>{html.escape(text)}</p>" for text in texts if text)

    def _ipython_key_completions_(self) -> list[str]:
        """Returns the names of the signals, for the tab key after `recording["`."""
        return list(self.signals)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Returns the signals as a table of pandas.

        The columns have two levels, the signal's name and the number of the component:
        `table["psi"]` contains all components of psi, `table["psi", 0]` the first one.
        Components that have names have them instead of numbers, as in
        `table["forward_packet_sent", "F_h x"]` and `table["state", "theta"]`. The index
        is the time in s; a jump has two rows with the same time.
        """
        import pandas  # The import takes half a second.

        return pandas.DataFrame(
            np.hstack(list(self.signals.values())),
            index=pandas.Index(self.time, name="time"),
            columns=pandas.MultiIndex.from_tuples(
                [
                    (name, component)
                    for name, x in self.signals.items()
                    for component in self.Components(name, x.shape[1])
                ],
                names=["signal", "component"],
            ),
        )

    def KeepSignals(self, names: Iterable[str]) -> None:
        """Discards all signals but those named, after the deferred fields are found."""
        for name in list(self.__dict__.get("_finders", ())):
            getattr(self, name)
        self.signals = {name: self.signals[name] for name in names}

    def WriteCsv(self, path: str | Path) -> None:
        """Writes the signals as a CSV file, completely or not at all.

        The first column is the time in s; a jump has two rows with the same time. The
        other columns are the components of the signals, such as `tool_velocity[0]` or
        `state[theta]`, in SI units.

        Raises:
            OSError: If the file cannot be written.
        """
        heads = ["time_s"]
        for name, x in self.signals.items():
            names = self.components.get(name, range(x.shape[1]))
            heads += [f"{name}[{component}]" for component in names]
        table = np.column_stack([self.time, *self.signals.values()])
        with Replacing(path) as file:
            np.savetxt(file, table, "%.10g", ",", header=",".join(heads), comments="")

    def Components(self, name: str, size: int) -> list[Any]:
        """Returns the names of a signal's components, or their numbers."""
        return list(self.components.get(name, range(size)))

    def Interpolate(self, name: str, times: Array) -> Array:
        """Returns a signal between its samples.

        Args:
            times: (M,) in s, clamped to the span of the recording.

        Returns:
            (M, k) values; at the instant of a jump, the value before it. In a run of
            simulate() they are accurate to 1e-4 of the signal's range; the outputs of
            delays in Drake's Simulator, to 5e-4. Notes name the signals of a System
            that jump or bend within a step.
        """
        return interpolate(self.time, self[name], self.steps, np.asarray(times))

    def Part(self: _R, begin: float, end: float) -> _R:
        """Returns a recording with the signals between two times.

        All other fields, such as the events and the termination, are those of the whole
        run.

        Args:
            begin: The first time, in s.
            end: The last time, in s.
        """
        time, signals, steps = part((self.time, self.signals, self.steps), begin, end)
        return replace(self, time=time, signals=signals, steps=steps)

    def EventTimes(self, name: str) -> list[float]:
        """Returns the times in s of all events with that name."""
        return [event.time for event in self.events if event.name == name]

    def Save(self, path: str | Path) -> None:
        """Writes the recording to an .npz file which LoadRecording() reads.

        The file appears complete or not at all.

        Args:
            path: The path of the file; `.npz` is not added.

        Raises:
            OSError: If the file cannot be written.
        """
        description = {"format": FORMAT, **self._Description()}
        arrays = {f"signal.{name}": x for name, x in self.signals.items()}
        text = json.dumps(description, default=_AsPlain)
        arrays["description"] = np.array(text)
        with Replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, time=self.time, steps=self.steps, **arrays)  # type: ignore[arg-type]

    def _Description(self) -> Record:
        """Returns all that a file stores besides the arrays, for JSON."""
        names = [item.name for item in fields(self)]
        return {x: getattr(self, x) for x in names if x not in self._not_plain}

    @classmethod
    def _FieldsOf(cls, description: Record) -> Record:
        """Returns the fields of a recording from what Save() has described."""
        events = [Event(**event) for event in description["events"]]
        solver = SolverStatistics(**description["solver"])
        channels = {}
        if description["channels"]:
            from teleop_drake.loops.delays.packet_statistics import PacketStatistics

            channels = {
                name: PacketStatistics(**statistics)
                for name, statistics in description["channels"].items()
            }
        own = {"events": events, "solver": solver, "channels": channels}
        return {**description, **own}


def _AsPlain(x: Any) -> Any:
    """Returns a dataclass or an array as a dict or a list, for JSON."""
    return x.tolist() if isinstance(x, np.ndarray) else asdict(x)


def CheckRecording(path: str, value: Any) -> None:
    """Refuses an argument that is not a Recording.

    Raises:
        WrongKind: If it is not.
    """
    CheckKind(path, value, Recording, "a Recording, which simulate() returns")


def ReadRecording(
    path: str | Path, kind_of: Callable[[Record], type[Recording]]
) -> Recording:
    """Reads a recording that Save() wrote.

    Args:
        kind_of: A function that returns the class of a recording from its description.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file is not a recording, or has another format. The message
            is one line.
    """
    CheckKind("path", path, str | os.PathLike, "the path of a recording")
    try:
        # np.load() leaves a file open if it opened the file and cannot read it.
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as data:
            arrays = dict(data)
        description = json.loads(str(arrays.pop("description")))
        found = description.pop("format", None)
    except OSError:
        raise
    except Exception:  # noqa: BLE001 - zipfile, zlib, numpy and json raise many kinds.
        raise ValueError(f"{path}: must be a recording of teleop-drake") from None
    try:
        if found != FORMAT:
            raise ValueError(f"it has format {found}")
        kind = kind_of(description)
        signals = {
            name.removeprefix("signal."): samples
            for name, samples in arrays.items()
            if name.startswith("signal.")
        }
        return kind(
            time=arrays["time"],
            steps=arrays["steps"],
            signals=signals,
            **kind._FieldsOf(description),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as e:
        lacks = f"it has no {e}" if isinstance(e, KeyError) else e
        raise ValueError(
            f"{path}: must be a recording of format {FORMAT}, as this version of "
            f"teleop-drake writes it ({lacks})"
        ) from None
