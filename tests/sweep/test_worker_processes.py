"""Tests of teleop_drake.sweep.workers."""

import os
import signal
import subprocess
import sys
import time

import pytest

from teleop_drake.sweep.workers import WorkerProcesses

# The server that forks them is started once.
pytestmark = pytest.mark.xdist_group("sweep")


@pytest.fixture(scope="module")
def pool():
    with WorkerProcesses(2) as pool:
        yield pool


def test_calls_run_in_other_processes(pool):
    futures = [pool.submit(os.getpid) for _ in range(20)]
    pids = {future.result() for future in futures}
    assert 1 <= len(pids) <= 2
    assert os.getpid() not in pids
    assert pool.submit(int, "ff", base=16).result() == 255


def test_an_exception_comes_back():
    with WorkerProcesses(1) as pool:
        pid = pool.submit(os.getpid).result()
        with pytest.raises(ZeroDivisionError):
            pool.submit(divmod, 1, 0).result()
        with pytest.raises(SystemExit):
            pool.submit(sys.exit, 3).result()
        with pytest.raises(RuntimeError, match="pickle"):
            pool.submit(open, os.devnull).result()
        assert pool.submit(os.getpid).result() == pid


def test_a_death_fails_one_call_only(pool):
    futures = [pool.submit(pow, 2, k) for k in range(6)]
    victim = pool.submit(os._exit, 3)
    others = [pool.submit(pow, 3, k) for k in range(6)]
    with pytest.raises(RuntimeError, match=r"the worker process ended \(exit code 3\)"):
        victim.result()
    assert [future.result() for future in futures] == [2**k for k in range(6)]
    assert [future.result() for future in others] == [3**k for k in range(6)]
    with pytest.raises(RuntimeError, match="killed by signal 9"):
        pool.submit(signal.raise_signal, signal.SIGKILL).result()


def test_processes_are_not_interrupted(pool):
    """Ctrl-C reaches the whole group, but is for the owner only."""
    assert pool.submit(signal.raise_signal, signal.SIGINT).result() is None


def test_processes_are_recycled(monkeypatch):
    """A new one has the environment as it is then."""
    with WorkerProcesses(1, calls_per_process=2) as pool:
        pids = [pool.submit(os.getpid).result() for _ in range(2)]
        monkeypatch.setenv("A_VARIABLE", "of today")
        pids.append(pool.submit(os.getpid).result())
        assert pool.submit(os.getenv, "A_VARIABLE").result() == "of today"
    assert pids[0] == pids[1] != pids[2]


def test_shutdown_finishes_or_kills():
    pool = WorkerProcesses(1)
    future = pool.submit(pow, 2, 5)
    pool.shutdown()
    assert future.result() == 32
    with pytest.raises(RuntimeError):
        pool.submit(pow, 2, 5)

    pool = WorkerProcesses(1)
    pid = pool.submit(os.getpid).result()
    busy, waiting = pool.submit(time.sleep, 60), pool.submit(pow, 2, 5)
    while not busy.running():
        time.sleep(0.01)
    start = time.monotonic()
    pool.shutdown(cancel_futures=True)
    assert time.monotonic() - start < 20
    assert waiting.cancelled()
    assert isinstance(busy.exception(), RuntimeError)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@pytest.mark.parametrize("name", ["jobs", "calls_per_process"])
def test_bad_arguments(name):
    with pytest.raises(ValueError, match=f"{name} = 0"):
        WorkerProcesses(**{"jobs": 1, name: 0})


def test_an_unguarded_script_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from teleop_drake.sweep.workers import WorkerProcesses\n"
        "with WorkerProcesses(1) as pool:\n"
        "    pool.submit(pow, 2, 5).result()\n"
    )
    result = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert result.returncode == 1
    last_line = result.stderr.splitlines()[-1]
    assert last_line.startswith("concurrent.futures._base.BrokenExecutor: ")
    assert 'if __name__ == "__main__":' in last_line
