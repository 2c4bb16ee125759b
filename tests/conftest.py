"""What the tests of every folder share."""

import gc
import os
import signal
from concurrent.futures import ThreadPoolExecutor

import pytest
import runs
from hypothesis import settings

# Byte code that one process has made of the package is there for all that the tests
# start: without it each takes twice as long to start.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# A shell that starts the tests in the background lets them ignore Ctrl-C, and with them
# what they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Other examples in every run; a test that needs more of them says so.
settings.register_profile("tests", max_examples=25)
settings.load_profile("tests")


def pytest_collection_finish():
    """Lets the garbage collector leave alone what is imported, half a million objects.

    Else it looks at them every few seconds, for a tenth of the time of the tests.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(700, 10, 200)


@pytest.fixture(scope="session", autouse=True)
def _SharedRuns(tmp_path_factory):
    """Lets the processes of pytest-xdist share what they simulate."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        runs.folder = tmp_path_factory.getbasetemp().parent


@pytest.fixture
def unrendered(monkeypatch):
    """Lets commands make and save their figures blank.

    To draw them is most of what a command does. Each is drawn in figures/.
    """
    monkeypatch.setattr("matplotlib.figure.Figure.draw", lambda self, renderer: None)


@pytest.fixture
def in_this_process(monkeypatch):
    """Lets sweeps simulate here; sweep/test_sweep.py has them in other processes."""
    monkeypatch.setattr(
        "teleop_drake.sweep.run.WorkerProcesses", lambda jobs: ThreadPoolExecutor(1)
    )
