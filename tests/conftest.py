"""What the tests of every folder share."""

import os

import pytest
import runs


@pytest.fixture(scope="session", autouse=True)
def _SharedRuns(tmp_path_factory):
    """Lets the processes of pytest-xdist share what they simulate."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        runs.folder = tmp_path_factory.getbasetemp().parent
