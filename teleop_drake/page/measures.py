"""Measures of a run as data, which the page's script evaluates as tasks/ does.

A form is a sum of weights times what is watched: columns of the rows, columns as they
were a delay ago, and 1. A measure is an operation on forms from one instant to another.
The weights are numbers of the run: they may depend on inputs.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_drake.environments import CONTACT, PUNCTURE, FindSurface, Surface
from teleop_drake.scenario import AnyScenario, AsTeleoperation
from teleop_drake.signals import AxesOf, AxisUnit
from teleop_drake.tasks import Insertion, TaskOf, Tracking
from teleop_drake.tasks.insertion import (
    AT_REST,
    CROSSINGS,
    SETTLING_RATIO,
    FirstNormal,
)

Array = NDArray[np.float64]

# The measures of a surface that is crossed, by its name: operation, forms, and until
# when. Instants are the first that happened of some; without one there is no measure.
_OF_SURFACES = {
    "puncture": {
        "time": ("time", [], "end"),
        "velocity": ("before", ["v"], "end"),
        "force": ("before", ["F"], "end"),
        "velocity_overshoot": ("maximum", ["excess"], "contact after puncture|end"),
    },
    "collision": {
        "time": ("time", [], "end"),
        "velocity": ("before", ["v"], "end"),
        "initial_impact_force": ("maximum", ["F"], "release after contact|end"),
        "peak_force": ("maximum", ["F"], "end"),
        "rebound_velocity": ("minimum", ["v"], "end"),
        "settling_time": ("settling", ["fast", "back"], "end"),
    },
}


@dataclass(kw_only=True)
class Measures:
    """What is measured.

    Attributes:
        columns: Of the rows that are watched.
        late: Those that are watched as they were the delay of the command ago.
        forms: The weights of each, by name.
        events: The forms that cross 0 where something happens, and what it is called
            upwards and downwards; "" without a name.
        mode: The column of the operator's mode.
        rows: Name, operation, forms, begin, end and label of each measure.
    """

    columns: list[int] = field(default_factory=list)
    late: list[int] = field(default_factory=list)
    forms: dict[str, Array] = field(default_factory=dict)
    events: list[tuple[str, str, str]] = field(default_factory=list)
    mode: int | None = None
    rows: list[list[Any]] = field(default_factory=list)

    @property
    def weights(self) -> Array:
        """The weights of all forms, one after another."""
        return np.concatenate([np.zeros(0), *self.forms.values()])

    def Data(self) -> dict[str, Any]:
        """Returns all but the weights, for the page's script."""
        return {**vars(self), "forms": list(self.forms)}

    def Watch(self, *ports: tuple[int, int, str], late: bool = False) -> None:
        """Watches the columns of some ports, which have begin and size."""
        columns = self.late if late else self.columns
        columns += [i for begin, size, _ in ports for i in range(begin, begin + size)]

    def Vectors(self, num_axes: int) -> Array:
        """Returns the weights (k, n, w) of the k vectors that are watched, one each."""
        size = len(self.columns) + len(self.late)
        return np.eye(size, size + 1).reshape(-1, num_axes, size + 1)

    def AddRow(self, task: Any, name: str, *row: Any) -> None:
        """Adds a measure with its label."""
        whole, _, axis = name.rpartition(".")
        unit = AxisUnit(task.units.get(name) or task.units.get(f"{whole}.*", ""), axis)
        label = name.replace("_", " ").replace(".", ": ")
        self.rows.append([name, *row, f"{label} [{unit}]" if unit else label])

    def AddPerAxis(self, task: Any, name: str, operation: str, forms: Array) -> None:
        """Adds a measure of the whole run for each axis."""
        for axis, form in zip(AxesOf(len(forms)), forms, strict=True):
            self.forms[f"{name}.{axis}"] = form
            used = [f"{name}.{axis}"]
            self.AddRow(task, f"{name}.{axis}", operation, used, "begin", "end")


def MeasuresOf(
    scenario: AnyScenario,
    signals: Mapping[str, tuple[int, int, str]],
    surfaces: tuple[Surface, ...],
    *,
    is_constant: bool,
) -> Measures:
    """Returns what is measured of the runs of a scenario.

    Nothing of a task whose metrics or events are of its own.

    Args:
        signals: Begin and size in a row of each signal.
        surfaces: Of the environment.
        is_constant: Whether the operator commands surgeon.velocity all the time.
    """
    task = TaskOf(scenario)
    if type(task).Metrics is Tracking.Metrics:
        return _OfTracking(scenario.num_axes, task, signals)
    if type(task).Metrics is not Insertion.Metrics:
        return Measures()
    v_d = np.asarray(AsTeleoperation(scenario).surgeon.velocity, float)
    n = v_d.size
    speed = float(np.linalg.norm(v_d))
    result = Measures(mode=signals["surgeon_mode"][0])
    names = "tool_position", "tool_velocity", "environment_force", "control_force"
    result.Watch(*(signals[name] for name in names))
    if "felt_velocity" in signals:
        result.Watch(signals["felt_velocity"])
    else:
        packet, *_ = signals["return_packet_received"]
        result.Watch((packet + n, n, "m/s"))
    if "velocity_command" in signals:
        sent = signals["force_command"], signals["velocity_command"]
        result.Watch(*sent, late=True)
    else:
        result.Watch(signals["forward_packet_received"])
    p, v, F, F_c, felt, F_hd, v_dd = result.Vectors(n)
    one = np.append(np.zeros(7 * n), 1.0)
    forms = result.forms
    for surface in surfaces:
        into, out = CROSSINGS.get(surface.name, ("", ""))
        forms[f"{surface.name} depth"] = depth = surface.normal_W @ p
        # A layer may begin at infinity, along axes on which its normal has a part.
        is_along = surface.normal_W != 0
        depth[-1] = -surface.point_W[is_along] @ surface.normal_W[is_along]
        result.events.append((f"{surface.name} depth", into, out))
    normal = FirstNormal(surfaces, v_d)
    along = v_d @ normal * one if is_constant else normal @ v_dd
    forms["excess"] = normal @ v - along
    forms["command"] = along + AT_REST * speed * one
    result.events.append(("command", "", ""))
    before = "puncture|contact|end"
    result.AddRow(task, "start_velocity_overshoot", "rise", ["excess"], "begin", before)
    for name, surface_name in (("puncture", PUNCTURE), ("collision", CONTACT)):
        if (found := FindSurface(surfaces, surface_name)) is None:
            continue
        v_x, slow = found.normal_W @ v, SETTLING_RATIO * speed * one
        own = {"v": v_x, "F": found.normal_W @ F}
        own |= {"fast": v_x - slow, "back": -v_x - slow}
        forms.update({f"{name} {x}": form for x, form in own.items()})
        for measure, (operation, used, until) in _OF_SURFACES[name].items():
            used = [f"{name} {x}" if x in own else x for x in used]
            begin = CROSSINGS[surface_name][0]
            result.AddRow(task, f"{name}.{measure}", operation, used, begin, until)
    if FindSurface(surfaces, CONTACT) is not None:
        own = {f"{k} of v and F": form for k, form in enumerate((*v, *F))}
        own |= {"slow": SETTLING_RATIO * speed * one, "near": SETTLING_RATIO * one}
        forms.update(own)
        result.AddRow(task, "collision.rest_time", "rest", [*own], "contact", "end")
    result.AddPerAxis(task, "velocity_rms_error", "rms", v - v_dd)
    result.AddPerAxis(task, "force_rms_error", "rms", F - F_hd)
    for axis, *pair in zip(AxesOf(min(n, 3)), felt, p, strict=False):
        used = [f"felt {axis}", f"p {axis}"]
        forms.update(zip(used, pair, strict=True))
        name = f"coordination_rms_error.{axis}"
        result.AddRow(task, name, "distance", used, "begin", "end")
    result.AddPerAxis(task, "control_force_peak", "peak", F_c)
    result.AddPerAxis(task, "control_force_variation", "variation", F_c)
    return result


def _OfTracking(
    num_axes: int, task: Any, signals: Mapping[str, tuple[int, int, str]]
) -> Measures:
    result = Measures()
    names = "tool_position", "desired_position"
    result.Watch(*(signals[name] for name in names))
    result.Watch(signals["disturbance_estimate"], signals["environment_force"])
    p, desired, estimate, F = result.Vectors(num_axes)
    result.AddPerAxis(task, "max_error", "peak", p - desired)
    result.AddPerAxis(task, "rms_error", "rms", p - desired)
    result.AddPerAxis(task, "disturbance_rms_error", "rms", estimate - F)
    return result
