"""Sweeps on all kinds of executors write the same bytes as this process."""

import multiprocessing
import os
import signal
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from pathlib import Path

import pytest

from teleop_drake.cli import main
from teleop_drake.model.run.compiled_scenario import CompiledScenario
from teleop_drake.study.sweep import Sweep, SweepError, plan, run

GRID = {"controller": ["direct_force", "adaptive_backstepping"]}
GRID["delay"] = [0.01 * k for k in range(1, 9)]
OVERRIDES = {"duration": 0.05, "simulator.accuracy": 1e-5}

# Only one process imports Dask.
pytestmark = [
    pytest.mark.xdist_group("sweep"),
    pytest.mark.usefixtures("in_an_empty_folder"),
]


def Files(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The files of the sweep if this process simulates it."""
    folder = tmp_path_factory.mktemp("here")
    Sweep("one_dof", GRID, overrides=OVERRIDES, out=folder)
    return Files(folder)


class Here(Executor):
    """An executor that makes calls at once, unless fail(number) returns an error."""

    def __init__(self, fail):
        self.fail = fail
        self.sizes = []

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.sizes.append(len(args[0].points))
        error = self.fail(len(self.sizes))
        if error is None:
            future.set_result(fn(*args, **kwargs))
        else:
            future.set_exception(error)
        return future


@pytest.mark.slow
def test_threads_give_the_same_bytes(expected):
    """The sweep does not shut down the executor."""
    with ThreadPoolExecutor(4) as executor:
        Sweep("one_dof", GRID, overrides=OVERRIDES, out="out", executor=executor)
        executor.submit(int).result()
    assert Files("out") == expected


@pytest.mark.slow
def test_calls_of_one_sweep_share_its_programs(monkeypatch):
    """A worker traces a structure once in a sweep, and again in the next one."""
    compiled = []

    def Counted(scenario):
        compiled.append(scenario.controller.kind)
        return CompiledScenario(scenario)

    monkeypatch.setattr(plan, "CompiledScenario", Counted)
    executor = Here(lambda call: None)
    for sweep in (1, 2):
        Sweep("one_dof", GRID, overrides=OVERRIDES, executor=executor)
        assert len(executor.sizes) == 16 * sweep
        assert compiled == sweep * GRID["controller"]


@pytest.mark.slow  # Two processes import the package.
def test_processes_of_the_standard_library_give_the_same_bytes(expected):
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as executor:
        Sweep("one_dof", GRID, overrides=OVERRIDES, out="out", executor=executor)
    assert Files("out") == expected


@pytest.mark.slow
def test_a_lost_call_is_done_again_run_by_run(expected, monkeypatch):
    monkeypatch.setattr(run, "_MIN_CALLS", 4)
    executor = Here(lambda number: OSError("lost") if number == 2 else None)
    Sweep("one_dof", GRID, overrides=OVERRIDES, out="out", executor=executor)
    assert executor.sizes == [4] * 4 + [1] * 4
    assert Files("out") == expected


def test_a_run_that_is_lost_again_fails():
    lost = {1, 9}  # Run 0 is in call 1, and is repeated in call 9.
    executor = Here(lambda number: OSError("no worker") if number in lost else None)
    grid = {"delay": GRID["delay"]}
    result = Sweep("one_dof", grid, overrides=OVERRIDES, executor=executor)
    assert [record["status"] for record in result.records[1:]] == ["completed"] * 7
    assert result.records[0]["status"] == "failed"
    assert result.records[0]["reason"] == "lost twice (no worker)"


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("error", "expected_error"),
    [
        (BrokenExecutor("it is gone"), "RuntimeError('it is gone'"),
        (KeyboardInterrupt(), "KeyboardInterrupt()"),
    ],
)
def test_a_sweep_goes_on_after_an_executor_gave_up(error, expected_error, expected):
    executor = Here(lambda number: error if number == 3 else None)
    common = {"overrides": OVERRIDES, "out": "out"}
    with pytest.raises((RuntimeError, KeyboardInterrupt)) as info:
        Sweep("one_dof", GRID, executor=executor, **common)
    assert repr(info.value).startswith(expected_error)
    assert Path("out/runs.jsonl").read_bytes().count(b"\n") < 16
    Sweep("one_dof", GRID, resume=True, **common)
    assert Files("out") == expected


def test_cancelled_calls_end_the_sweep():
    class Cancelling(Executor):
        def submit(self, fn, /, *args, **kwargs):
            future = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    with pytest.raises(RuntimeError, match="the executor cancelled a run"):
        Sweep("one_dof", GRID, overrides=OVERRIDES, executor=Cancelling())


def test_workers_of_another_version_are_refused():
    """Their records could differ, without any sign in the records."""

    class Another(Here):
        def submit(self, fn, /, *args, **kwargs):
            *others, versions = args
            return super().submit(fn, *others, versions | {"drake": "1.0"}, **kwargs)

    class Raising(Another):
        def submit(self, fn, /, *args, **kwargs):
            future = Future()
            try:
                super().submit(fn, *args, **kwargs)
            except SweepError as error:
                future.set_exception(error)
            return future

    with pytest.raises(SweepError, match=r"must have workers with .*'drake': '1\.0'"):
        Sweep("one_dof", GRID, executor=Raising(lambda number: None))


def test_jobs_are_those_of_this_machine(capsys):
    with pytest.raises(SweepError, match="jobs = 2: must be None where an executor"):
        Sweep("one_dof", GRID, jobs=2, executor=Here(lambda number: None))
    options = ["--delay", "0.1", "--jobs", "2", "--dask", "host:1"]
    assert main(["sweep", "one_dof", *options]) == 2
    assert "--jobs = 2: must be left out with --dask" in capsys.readouterr().err


# Dask.


@pytest.fixture(scope="module")
def distributed():
    return pytest.importorskip("distributed")


def Cluster(distributed, **options):
    return distributed.LocalCluster(
        threads_per_worker=1, host="127.0.0.1", dashboard_address=":0", **options
    )


@pytest.mark.slow
def test_the_command_waits_for_workers(
    distributed, expected, capsys, monkeypatch, unrendered
):
    """The command reports that there are no workers, and waits for them."""
    options = ["--duration", "0.05", "--accuracy", "1e-5", "--delay", "0.01:0.08:8"]
    with Cluster(distributed, n_workers=0, processes=False, protocol="tcp") as cluster:
        address = cluster.scheduler_address
        get_executor = distributed.Client.get_executor

        def StartWorker(client, **options):
            cluster.scale(1)
            return get_executor(client, **options)

        # A worker starts after the command has found none.
        monkeypatch.setattr(distributed.Client, "get_executor", StartWorker)
        command = ["sweep", "one_dof", *options, "--dask", address, "--quiet"]
        assert main(command) == 0
    assert f"{address} has no workers; the runs wait" in capsys.readouterr().err
    assert Path("out/runs.jsonl").read_bytes() == expected["runs.jsonl"]


def test_no_scheduler(distributed, capsys):
    address = "x://y:1"
    assert main(["sweep", "one_dof", "--delay", "0.1", "--dask", address]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"teleop-drake: error: --dask = {address!r}: must be the")
    assert err.count("\n") == 1
    assert os.listdir() == []


@pytest.mark.slow  # Three processes import the package.
def test_a_cluster_that_loses_a_worker_gives_the_same_bytes(distributed):
    """One of two workers is killed while it simulates; its calls are repeated."""
    grid = {"delay": [0.01 * k for k in range(1, 65)]}
    overrides = {"duration": 2.0}
    Sweep("one_dof", grid, overrides=overrides, out="here")
    killed = []
    with (
        Cluster(distributed, n_workers=2, processes=True) as cluster,
        distributed.Client(cluster) as client,
    ):

        def Kill(finished, runs):
            if finished >= 4 and not killed:
                tasks = client.processing()
                busy = next(address for address, keys in tasks.items() if keys)
                pid = client.run(os.getpid, workers=[busy])[busy]
                killed.append(pid)
                os.kill(pid, signal.SIGKILL)

        Sweep(
            "one_dof",
            grid,
            overrides=overrides,
            out="there",
            executor=client.get_executor(pure=False),
            progress=Kill,
        )
    assert len(killed) == 1
    assert Files("there") == Files("here")
