"""Sweeps on a Dask cluster: a real scheduler, spoken to through its address."""

import json
import os
import signal
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from teleop_drake.cli import main
from teleop_drake.sweep import Sweep

OVERRIDES = {"duration": 0.02, "simulator.accuracy": 1e-5}
GRID = {"delay": [0.01 * k for k in range(1, 7)]}

# One process imports it.
pytestmark = pytest.mark.xdist_group("dask")


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


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


@pytest.mark.slow  # test_sweep.py kills processes of its own.
def test_a_killed_worker_costs_no_run(distributed, expected):
    with (
        Cluster(distributed, n_workers=2, processes=True) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = client.run(os.getpid)
        assert len(set(pids.values())) == 2
        victim = next(iter(pids.values()))

        def Progress(finished, runs):
            if finished == 3:
                os.kill(victim, signal.SIGKILL)

        result = Sweep(
            "one_dof",
            GRID,
            overrides=OVERRIDES,
            engine="drake",
            executor=client.get_executor(pure=False),
            out="out",
            progress=Progress,
        )
        client.wait_for_workers(2, timeout=60)
        assert victim not in client.run(os.getpid).values()
    assert result.records == expected
    lines = Path("out/runs.jsonl").read_text().splitlines()
    records = [json.loads(line) for line in lines]
    assert records == expected


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
