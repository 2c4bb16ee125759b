"""What several tests of the thesis look at is made once."""

import functools
from types import SimpleNamespace

import pytest
from grids import Slow
from runs import TASKS, Simulated

from teleop_drake.scenario import LoadScenario, ScenarioToYaml
from teleop_drake.simulation import simulate
from teleop_drake.thesis import report, studies
from teleop_drake.thesis.claims.evidence import Evidence
from teleop_drake.thesis.claims.future_work import Learning
from teleop_drake.thesis.claims.requests import REQUESTS
from teleop_drake.thesis.figures import FIGURES
from teleop_drake.thesis.ledger import Ledger
from teleop_drake.thesis.runs import ThesisRuns
from teleop_drake.thesis.studies.lyapunov import LyapunovTelemetry


@pytest.fixture(scope="session")
def progress_lines():
    return []


@functools.cache
def SharedRuns():
    return {
        ScenarioToYaml(LoadScenario(name, {"controller.kind": kind}))
        for name in TASKS
        for kind in ("direct_force", "adaptive_backstepping")
    }


def Simulate(scenario, engine):
    if ScenarioToYaml(scenario) in SharedRuns():
        return Simulated(scenario)
    return simulate(scenario, engine="auto")


class Runs(ThesisRuns):
    """The runs of the thesis; its tasks as they stand are those of other tests too.

    All others are machine code, which takes less than half of the time.
    """

    def __call__(self, name, /, **overrides):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("teleop_drake.thesis.runs.simulate", Simulate)
            return super().__call__(name, **overrides)


@pytest.fixture(scope="session")
def thesis_runs(progress_lines):
    with Runs(1, progress_lines.append) as runs:
        # First what no other test simulates.
        for name, overrides in reversed(REQUESTS):
            runs(name, **overrides)
        yield runs


@pytest.fixture(scope="session")
def ledger(thesis_runs):
    return Ledger(thesis_runs)


@pytest.fixture(scope="session")
def on_learning(thesis_runs):
    return OnLearning(thesis_runs)


@functools.cache
def OnLearning(runs):
    """The rows of future work that take no compiling of many diagrams."""
    return Learning(Evidence(runs))


@pytest.fixture(scope="session", params=Slow(["a few figures", "everything"]))
def reproduced(request, thesis_runs, ledger, tmp_path_factory):
    """A folder with what `teleop-drake reproduce` writes.

    The short run of the tests makes the whole ledger but for most of future work, draws
    a few figures and makes one of the studies.
    """
    lines: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "a few figures":
            figures = {number: FIGURES[number] for number in ("2.1", "4.5")}
            patch.setattr(report, "FIGURES", figures)
            patch.setattr(report, "STUDIES", (LyapunovTelemetry,))
            patch.setattr(studies, "REQUESTS", [])
            patch.setattr(report, "FutureWork", OnLearning)
        figures = list(report.FIGURES.values())
        folder = tmp_path_factory.mktemp("reproduced")
        paths = report.WriteReport(thesis_runs, folder, ["png"], lines.append)
        rows = [*ledger, *report.FutureWork(thesis_runs)]
    return SimpleNamespace(
        folder=folder, paths=paths, figures=figures, lines=lines, rows=rows
    )
