"""What a run did, in words. page/js/words.js has the same rules and words."""

from collections.abc import Mapping, Sequence
from typing import Any

from teleop_drake.model.blocks.environments import CONTACT, PUNCTURE
from teleop_drake.model.signals import AxesOf, AxisUnit, ScaleAndUnit
from teleop_drake.model.task_recording import TaskRecording

# A later force is told if it exceeds the first impact by this factor.
_HARDER = 1.05

# How the reasons begin of runs that end where a signal leaves its range, but for the
# speed of the tool; see BoundsOf().
_RANGES = ("joint ", "the tool is turned ")


def Quantity(value: float, unit: str) -> str:
    """Returns a value with two significant digits or as a whole number, and its unit.

    The unit has an SI prefix, as in "8.7 mN".
    """
    scale, shown = ScaleAndUnit([value], unit)
    number = value * scale
    if abs(number) >= 9.95:
        return f"{number:.0f} {shown}"
    return f"{number:#.2g} {shown}"


def Sentence(recording: TaskRecording, clauses: Sequence[str]) -> str:
    """Returns the sentence of some clauses, whose subject is the controller."""
    kind = recording.scenario.controller.kind.rpartition(":")[2]
    title = kind[0].upper() + kind[1:].replace("_", " ")
    *first, last = clauses
    # With three clauses, a comma stands before "and", too.
    link = ", and " if len(first) > 1 else " and "
    said = f"{', '.join(first)}{link}{last}" if first else last
    return f"{title} {said}."


def EndInWords(recording: TaskRecording) -> str:
    """Returns how a run ended that did not reach its end; "" for any other."""
    if recording.termination == "completed":
        return ""
    end = _SpanInWords(recording)
    if recording.termination == "interrupted":
        return f"was interrupted after {end}"
    if recording.reason.startswith("the tool's speed"):
        return f"ran away after {end}"
    if recording.reason.startswith(_RANGES):
        return f"ended after {end}, where {recording.reason.partition(',')[0]}"
    return f"cannot be simulated beyond {end}"


def DurationInWords(recording: TaskRecording) -> str:
    """Returns how a run ended, or else how long it took."""
    return EndInWords(recording) or f"ran for {_SpanInWords(recording)}"


def _SpanInWords(recording: TaskRecording) -> str:
    """Returns the simulated time of a run."""
    return Quantity(float(recording.time[-1] - recording.time[0]), "s")


def InsertionInWords(recording: TaskRecording, metrics: Mapping[str, Any]) -> list[str]:
    """Returns the clauses on an insertion, from its metrics."""
    puncture = metrics["puncture"]
    collision = metrics["collision"]
    end = EndInWords(recording)
    clauses = []
    if collision is not None:
        first = collision["initial_impact_force"]
        largest = collision["peak_force"]
        hard = _NameBehind(recording, CONTACT)
        clauses.append(f"hit the {hard} with {Quantity(first, 'N')}")
        if largest > _HARDER * first:
            clauses.append(f"later with up to {Quantity(largest, 'N')}")
    elif puncture is not None:
        time = Quantity(puncture["time"], "s")
        clauses.append(f"went through the {_NameBefore(recording, PUNCTURE)} at {time}")
    if not recording.surfaces:
        errors = _PerAxis(metrics["velocity_rms_error"], "m/s")
        clauses.append(f"followed the commanded velocity to within {errors} (rms)")
    if end:
        clauses.append(end)
    elif collision is not None:
        rest = collision["rest_time"]
        clauses.append(
            "did not come to rest"
            if rest is None
            else f"came to rest after {Quantity(rest, 's')}"
        )
    elif recording.FindSurface(CONTACT) is not None:
        clauses.append(f"did not reach the {_NameBehind(recording, CONTACT)}")
    return clauses or [DurationInWords(recording)]


def TrackingInWords(recording: TaskRecording, metrics: Mapping[str, Any]) -> list[str]:
    """Returns the clauses on a tracking, from its metrics."""
    errors = _PerAxis(metrics["max_error"], "m")
    clauses = [f"followed the path to within {errors}"]
    end = EndInWords(recording)
    return [*clauses, end] if end else clauses


def _PerAxis(values: Sequence[float], unit: str) -> str:
    """Returns a value for each axis of the task, as in "x 63 mm, y 0.11 m"."""
    if len(values) == 1:
        return Quantity(values[0], unit)
    return ", ".join(
        f"{axis} {Quantity(value, AxisUnit(unit, axis))}"
        for axis, value in zip(AxesOf(len(values)), values, strict=True)
    )


def _NameBehind(recording: TaskRecording, name: str) -> str:
    """Returns the name of the material behind a surface."""
    surface = recording.FindSurface(name)
    material = None if surface is None else surface.material
    return "surface" if material is None else material.name


def _NameBefore(recording: TaskRecording, name: str) -> str:
    """Returns the name of the material in front of a surface."""
    names = [surface.name for surface in recording.surfaces]
    place = names.index(name)
    material = recording.surfaces[place - 1].material if place > 0 else None
    return "surface" if material is None else material.name
