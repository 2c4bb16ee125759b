"""Sweeps on a Dask cluster: a real scheduler, spoken to through its address."""

import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from teleop_drake.cli import main
from teleop_drake.sweep import Sweep

OVERRIDES = {"duration": 0.02, "simulator.accuracy": 1e-5}
GRID = {"delay": [0.01 * k for k in range(1, 7)]}

# One process imports it.
pytestmark = [
    pytest.mark.xdist_group("dask"),
    pytest.mark.usefixtures("in_an_empty_folder"),
]


@pytest.fixture(scope="module")
def distributed():
    """The package, imported by the one process of the tests that needs it."""
    return pytest.importorskip("distributed")


OF_THIS_PROCESS = {"processes": False, "protocol": "tcp"}


def Cluster(distributed, **options):
    return distributed.LocalCluster(
        threads_per_worker=1, host="127.0.0.1", dashboard_address=":0", **options
    )


@pytest.fixture(scope="module")
def expected():
    with ThreadPoolExecutor(1) as executor:
        return Sweep(
            "one_dof", GRID, overrides=OVERRIDES, engine="drake", executor=executor
        ).records


def test_the_command(distributed, expected, capsys):
    """Without workers the runs wait, which the command says."""
    options = ["--duration", "0.02", "--accuracy", "1e-5", "--delay", "0.01:0.06:6"]
    options += ["--controllers", "adaptive_backstepping", "--json", "-"]
    options += ["--engine", "drake"]
    with Cluster(distributed, n_workers=0, **OF_THIS_PROCESS) as cluster:
        address = cluster.scheduler_address
        threading.Timer(0.5, cluster.scale, [1]).start()
        assert main(["sweep", "one_dof", *options, "--dask", address]) == 0
    out, err = capsys.readouterr()
    assert [x["metrics"] for x in json.loads(out)] == [x["metrics"] for x in expected]
    assert f"{address} has no workers; the runs wait" in err


def test_no_scheduler(distributed, capsys, monkeypatch):
    address = "x://y:1"
    client = distributed.Client
    monkeypatch.setattr(
        distributed, "Client", lambda address, timeout: client(address, timeout=1)
    )
    assert main(["sweep", "one_dof", "--delay", "0.1", "--dask", address]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"teleop-drake: error: --dask = {address!r}: must be the")
    assert err.count("\n") == 1
    assert os.listdir() == []
