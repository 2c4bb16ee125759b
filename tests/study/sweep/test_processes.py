"""The worker processes of a sweep may die, are replaced, and ignore Ctrl-C."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from teleop_drake.study.sweep import Execution, PlanSweep, RunSweep
from teleop_drake.study.sweep.plan import SweepPlan

# The server that forks the workers is started once.
pytestmark = pytest.mark.xdist_group("sweep")


@dataclass(kw_only=True)
class Deadly(SweepPlan):
    """A plan whose process dies when it loads certain masses, a number of times each.

    Otherwise it appends the process and a variable of the environment to a file.
    """

    folder: Path
    deaths: dict[str, int]

    def Load(self, point):
        signal.raise_signal(signal.SIGINT)  # Workers ignore it.
        for mass, num_deaths in self.deaths.items():
            file = self.folder / mass
            size = file.stat().st_size if file.exists() else 0
            if point["robot.mass"] == float(mass) and size < num_deaths:
                file.write_text((size + 1) * "x")
                os._exit(9)
        with open(self.folder / "pids", "a") as file:
            file.write(f"{os.getpid()} {os.getenv('A_VARIABLE')}\n")
        return super().Load(point)


def Run(folder, masses, **deaths):
    """Returns the records, and each process with its variable of the environment."""
    plan = PlanSweep(
        "one_dof", {"robot.mass": masses}, overrides={"duration": 0.01}, engine="drake"
    )
    plan = Deadly(**vars(plan), folder=folder, **deaths)
    records = RunSweep(plan, Execution(jobs=2)).records
    lines = (folder / "pids").read_text().splitlines()
    return records, dict(line.split() for line in lines)


@pytest.mark.slow
def test_a_run_whose_process_dies_is_tried_again(tmp_path):
    masses = [1.0, 2.0, 3.0, 4.0, 5.0]
    records, _ = Run(tmp_path, masses, deaths={"2.0": 2, "4.0": 1})
    assert records.pop(1) == {
        "run": 1,
        "varied": {"robot.mass": 2.0},
        "status": "failed",
        "reason": "lost twice (its process ended)",
        "metrics": None,
    }
    assert [record["status"] for record in records] == ["completed"] * 4
    assert [record["varied"]["robot.mass"] for record in records] == [1, 3, 4, 5]


@pytest.mark.slow
def test_processes_are_recycled(tmp_path, monkeypatch):
    """A new process gets the present environment."""
    monkeypatch.setattr("teleop_drake.study.sweep.workers._CALLS_PER_PROCESS", 1)
    monkeypatch.setenv("A_VARIABLE", "today")
    _, seen = Run(tmp_path, [1.0, 2.0, 3.0], deaths={})
    assert len(seen) >= 2 and set(seen.values()) == {"today"}
    assert str(os.getpid()) not in seen


@pytest.mark.slow  # Three processes import the package.
def test_an_unguarded_script_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from teleop_drake.study.sweep import Sweep\n"
        "Sweep('one_dof', {'robot.mass': [1.0]}, jobs=1)\n"
    )
    result = subprocess.run(
        [sys.executable, script], capture_output=True, check=False, text=True
    )
    assert result.returncode == 1
    last_line = result.stderr.splitlines()[-1]
    assert last_line.startswith("RuntimeError: a worker process could not start")
    assert 'if __name__ == "__main__":' in last_line
