"""What several tests of the thesis look at is made once."""

from types import SimpleNamespace

import pytest
from runs import Simulated

from teleop_drake.thesis import report
from teleop_drake.thesis.figures import FIGURES
from teleop_drake.thesis.report import Ledger
from teleop_drake.thesis.runs import ThesisRuns


@pytest.fixture(scope="session")
def progress_lines():
    return []


@pytest.fixture(scope="session")
def thesis_runs(progress_lines):
    """The runs of the thesis, which are also those of other tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("teleop_drake.thesis.runs.simulate", Simulated)
        yield ThesisRuns(progress_lines.append)


@pytest.fixture(scope="session")
def ledger(thesis_runs):
    return Ledger(thesis_runs)


@pytest.fixture(scope="session")
def reproduced(thesis_runs, ledger, tmp_path_factory):
    """A folder with what `teleop-drake reproduce` writes, with three of the figures."""
    lines: list[str] = []
    figures = {number: FIGURES[number] for number in ("2.1", "4.1", "4.5")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "FIGURES", figures)
        patch.setattr(report, "Ledger", lambda runs: ledger)
        folder = tmp_path_factory.mktemp("reproduced")
        paths = report.Reproduce(
            folder, formats=["png"], progress=lines.append, runs=thesis_runs
        )
    return SimpleNamespace(
        folder=folder, paths=paths, figures=list(figures.values()), lines=lines
    )
