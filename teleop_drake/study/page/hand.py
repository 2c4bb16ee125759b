"""The data of a drive by the user's hand, and the command that repeats it."""

import os
import shlex
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from teleop_drake.model.blocks.operators.recorded import RecordedConfig
from teleop_drake.model.scenario import Scenario, ScenarioToYaml
from teleop_drake.model.scenario.overrides import (
    CHANNELS,
    FieldsOf,
    Overrides,
    ParseOverrides,
)
from teleop_drake.model.scenario.tree import FieldTypes, ToTree
from teleop_drake.model.scenario.yaml_text import DumpValue

# The largest speed that a hand commands, in multiples of |surgeon.velocity|.
_FULL_SPEED = 2.0

# The file to which the page saves the hand.
_FILE = "hand.csv"

# Inputs of the page that are options of the command line.
_OPTIONS = ("delay", "forward_delay", "return_delay")

Settings = list[tuple[str, Any]]
"""Dotted paths of fields, and their values."""


def HandData(
    scenario: Scenario,
    source: Any,
    overrides: Overrides,
    kinds: Sequence[str],
    inputs: Collection[str],
) -> dict[str, Any]:
    """Returns the data of a drive for the page's script.

    The command that repeats a drive has four parts: `command`; the value of each input
    after its text in `options`; the duration; and `surgeon`.

    Args:
        scenario: The scenario with its overrides.
        source: The scenario, its name or file, as the page's maker gave it.
        overrides: The overrides, as the page's maker gave them.
        kinds: The controllers. A drive begins with the adaptive one if it is there.
        inputs: The names of the page's inputs.
    """
    v_d = np.asarray(scenario.surgeon.velocity, float)
    force = scenario.surgeon.contact_force
    adaptive = "adaptive_backstepping"
    # A scenario that is neither a name nor a file is saved beside the hand.
    is_named = isinstance(source, str | os.PathLike)
    name = os.fspath(source) if is_named else f"{scenario.name}.yaml"
    operator = _OperatorSettings(scenario)
    # Controllers, the duration and the values of inputs follow in the command, too.
    later = ["controller.kind", "duration", *(path for path, _ in operator)]
    later += [path for key in inputs for path in FieldsOf(key)]
    settings = _Without(later, ParseOverrides(overrides)) if is_named else []
    # The options of delays are applied before --set, which may replace a channel.
    has_options = not any(path.startswith(CHANNELS) for path, _ in settings)
    words = ["teleop-drake", "compare", name, "--controllers", ",".join(kinds)]
    return {
        "scenario": scenario.name,
        "first": adaptive if adaptive in kinds else kinds[0],
        "seed": getattr(scenario.forward_channel, "seed", None),
        "num_axes": v_d.size,
        "full_speed": _FULL_SPEED * float(np.linalg.norm(v_d)),
        # The force at which a gamepad rumbles most: twice the force held on contact.
        "newtons": 2 * float(np.linalg.norm(0.0 if force is None else force)),
        "settings": [f"{path}={DumpValue(value)}" for path, value in settings],
        "command": shlex.join([*words, *_Words(settings)]),
        "options": {
            key: f"--{key.replace('_', '-')} "
            if key in _OPTIONS and has_options
            else f"--set {key}="
            for key in inputs
        },
        "surgeon": shlex.join(_Words(operator)),
        "yaml": None if is_named else ScenarioToYaml(scenario),
    }


def _Without(paths: Collection[str], settings: Settings) -> Settings:
    """Returns the settings but those of some paths and of all that is below them."""
    begins = tuple(f"{path}." for path in paths)
    return [pair for pair in settings if not f"{pair[0]}.".startswith(begins)]


def _OperatorSettings(scenario: Scenario) -> Settings:
    """Returns the settings of an operator who repeats the hand.

    An operator that has fields of its own is replaced as a whole. A hand knows neither
    a force after contact nor a time of its stop.
    """
    surgeon = scenario.surgeon
    if {*FieldTypes(type(surgeon))} <= {*FieldTypes(RecordedConfig)}:
        return [
            ("surgeon.kind", RecordedConfig.kind),
            ("surgeon.file", _FILE),
            ("surgeon.contact_force", None),
            ("surgeon.stop_time", None),
        ]
    velocity = ToTree(surgeon.velocity)
    fields = {"kind": RecordedConfig.kind, "file": _FILE, "velocity": velocity}
    return [("surgeon", fields)]


def _Words(settings: Settings) -> list[str]:
    """Returns the words of settings on a command line."""
    words = []
    for path, value in settings:
        words += ["--set", f"{path}={DumpValue(value)}"]
    return words
