"""Simulations that several tests look at; each is run once, and shared as a file."""

import functools
import hashlib
import os
import pickle
import sys
import tempfile
from pathlib import Path

from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import AnyScenario, LoadScenario, ScenarioToYaml
from teleop_drake.model.task_recording import TaskRecording

TASKS = ("one_dof", "two_dof_puncture", "two_dof_collision", "two_dof_combined")

# The folder of the recordings, set by conftest.py; None keeps them in this process.
folder: Path | None = None

_recordings: dict[str, TaskRecording] = {}


def Simulated(scenario: AnyScenario, engine: str = "auto") -> TaskRecording:
    """Returns what simulate() returns; each run is simulated only once."""
    text = f"{engine}\n{ScenarioToYaml(scenario)}"
    if text not in _recordings:
        _recordings[text] = _Load(scenario, text) or _Simulate(scenario, engine, text)
    return _recordings[text]


@functools.cache
def Run(name: str, kind: str, *overrides: str, engine: str = "auto") -> TaskRecording:
    """Simulates a scenario with a controller; overrides are PATH=VALUE."""
    print("simulate", name, kind, *overrides, file=sys.stderr)
    scenario = LoadScenario(name, [f"controller.kind={kind}", *overrides])
    return Simulated(scenario, engine)


def _File(text: str) -> Path:
    assert folder is not None
    return folder / f"run_{hashlib.sha256(text.encode()).hexdigest()}.pickle"


def _Load(scenario: AnyScenario, text: str) -> TaskRecording | None:
    if folder is None or not _File(text).exists():
        return None
    parts = pickle.loads(_File(text).read_bytes())
    return TaskRecording(scenario=scenario, **parts)


def _Simulate(scenario: AnyScenario, engine: str, text: str) -> TaskRecording:
    recording = simulate(scenario, engine=engine)
    if folder is not None:
        parts = recording.__getstate__()
        del parts["scenario"]  # It does not pickle.
        with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
            pickle.dump(parts, file)
        os.replace(file.name, _File(text))
    return recording
