"""The processes of a sweep: they may die, are replaced, and leave Ctrl-C to it."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from teleop_drake.sweep import PlanSweep, RunSweep
from teleop_drake.sweep.plan import Source

# The server that forks them is started once.
pytestmark = pytest.mark.xdist_group("sweep")

MASSES = [1.0, 2.0, 3.0, 4.0, 5.0]


@dataclass(kw_only=True)
class Deadly(Source):
    """A scenario of which some loads end their process, and all leave its number."""

    folder: Path
    num_deaths: int = 0

    def Load(self, overrides):
        signal.raise_signal(signal.SIGINT)  # Is for the owner only.
        deaths = self.folder / "deaths"
        if "robot.mass=2.0" in overrides:
            text = deaths.read_text() if deaths.exists() else ""
            if len(text) < self.num_deaths:
                deaths.write_text(text + "x")
                os._exit(9)
        with open(self.folder / "pids", "a") as file:
            file.write(f"{os.getpid()} {os.getenv('A_VARIABLE')}\n")
        return super().Load(overrides)


def Run(folder, num_deaths=0, num_runs=5):
    """Returns the sweep, and the processes and what their environment says."""
    plan = PlanSweep(
        "one_dof",
        {"robot.mass": MASSES[:num_runs]},
        overrides={"duration": 0.01},
        engine="drake",
    )
    plan.source = Deadly(name="one_dof", text=None, folder=folder)
    plan.source.num_deaths = num_deaths
    result = RunSweep(plan, jobs=2)
    lines = (folder / "pids").read_text().splitlines()
    return result.records, [tuple(line.split()) for line in lines]


def test_a_run_whose_process_dies_is_tried_again(tmp_path):
    records, _ = Run(tmp_path, num_deaths=1)
    assert [record["status"] for record in records] == ["completed"] * 5
    (tmp_path / "deaths").unlink()
    others, _ = Run(tmp_path, num_deaths=2)
    assert others[1] == {
        "run": 1,
        "varied": {"robot.mass": 2.0},
        "status": "failed",
        "reason": "its process ended, and so did the second one",
        "metrics": None,
    }
    assert [others[0], *others[2:]] == [records[0], *records[2:]]


def test_processes_are_recycled(tmp_path, monkeypatch):
    """A new one has the environment as it is then."""
    monkeypatch.setattr("teleop_drake.sweep.run._RUNS_PER_PROCESS", 1)
    monkeypatch.setenv("A_VARIABLE", "today")
    _, seen = Run(tmp_path, num_runs=3)
    assert len(seen) == 3 and len(set(seen)) >= 2
    assert {value for _, value in seen} == {"today"}
    assert str(os.getpid()) not in dict(seen)


@pytest.mark.slow  # It imports the package three times.
def test_an_unguarded_script_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from teleop_drake.sweep import Sweep\n"
        "Sweep('one_dof', {'robot.mass': [1.0]}, jobs=1)\n"
    )
    result = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert result.returncode == 1
    last_line = result.stderr.splitlines()[-1]
    assert last_line.startswith("RuntimeError: a worker process could not start")
    assert 'if __name__ == "__main__":' in last_line
