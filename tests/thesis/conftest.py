"""What several tests of the thesis look at is made once."""

from types import SimpleNamespace

import pytest

from teleop_drake.thesis.report import WriteReport
from teleop_drake.thesis.runs import ThesisRuns


@pytest.fixture(scope="session")
def progress_lines():
    return []


@pytest.fixture(scope="session")
def thesis_runs(progress_lines):
    # The runs are few, and compiling takes longer.
    with ThesisRuns(2, progress_lines.append, engine="drake") as runs:
        yield runs


@pytest.fixture(scope="session")
def reproduced(thesis_runs, progress_lines, tmp_path_factory):
    """A folder with everything that `teleop-drake reproduce` writes."""
    folder = tmp_path_factory.mktemp("reproduced")
    paths = WriteReport(thesis_runs, folder, progress_lines.append)
    return SimpleNamespace(folder=folder, paths=paths)
