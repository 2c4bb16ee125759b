"""What the tests of every folder share."""

import gc
import os
import random
import signal
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from browsers import browser, look, session_browser
from hypothesis import settings

# Fixtures of all folders, so that they share one browser.
__all__ = ["browser", "look", "session_browser"]

# Byte code that one process has made of the package and of the tests is there for all
# that the tests start, and for the next run: without it each takes twice as long.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Matrices are small here. The threads of BLAS would wait for each other, beside as many
# processes as there are processors. NumPy reads this when it is imported, so nothing
# above may import it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell that starts the tests in the background lets them ignore Ctrl-C, and with them
# what they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The short run has the same examples each time. The slow run searches at random, with a
# seed that it prints; what it finds becomes an example of its test.
settings.register_profile("short", derandomize=True, max_examples=15, deadline=None)
settings.register_profile("search", max_examples=100, deadline=None)
settings.load_profile("short")


def _IsSlowRun(config):
    """Returns whether this is `pytest -m slow`."""
    return config.option.markexpr == "slow"


@pytest.hookimpl(tryfirst=True)  # Hypothesis and pytest-xdist read the seed.
def pytest_configure(config):
    """Chooses between the same examples and a search."""
    if _IsSlowRun(config):
        settings.load_profile("search")
        if config.option.hypothesis_seed is None:
            config.option.hypothesis_seed = random.randrange(2**32)


def pytest_terminal_summary(terminalreporter, config):
    """Prints the seed of a search."""
    if _IsSlowRun(config):
        terminalreporter.write_line(
            f"--hypothesis-seed={config.option.hypothesis_seed}"
        )


@pytest.hookimpl(tryfirst=True)  # Before `-m slow` selects.
def pytest_collection_modifyitems(config, items):
    """Marks slow cases, and lets the slow run search with every property."""
    seen = set()
    for item in items:
        if not item.get_closest_marker("mostly_slow") or "slow" in item.keywords:
            continue
        # The first case belongs to the short run.
        if item.obj in seen:
            item.add_marker("slow")
        seen.add(item.obj)
    for item in items if _IsSlowRun(config) else []:
        if getattr(item.obj, "is_hypothesis_test", False):
            item.add_marker("slow")


def pytest_collection_finish():
    """Lets the garbage collector leave alone what is imported, half a million objects.

    Else it looks at them every few seconds, for a tenth of the time of the tests.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 100)


def pytest_sessionfinish():
    """Collects what is left over once; pytest does so five times, and finds nothing."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _SharedRuns(tmp_path_factory):
    """Lets the processes of pytest-xdist share what they simulate."""
    import runs  # It imports NumPy.

    if "PYTEST_XDIST_WORKER" in os.environ:
        runs.folder = tmp_path_factory.getbasetemp().parent


@pytest.fixture
def in_an_empty_folder(tmp_path, monkeypatch):
    """Lets a test write where nothing is."""
    monkeypatch.chdir(tmp_path)


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
        "teleop_drake.study.sweep.run.Workers",
        lambda jobs, preload: ThreadPoolExecutor(1),
    )
