"""Worker processes that survive their deaths: an Executor of the standard kind."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any, ParamSpec, TypeVar, cast

from teleop_drake.validation import CheckNumber

_P = ParamSpec("_P")
_T = TypeVar("_T")

# In Drake before 1.56 a simulation leaks up to two megabytes, because a Diagram with a
# LeafSystem written in Python is never freed.
CALLS_PER_PROCESS = 100

# What processes are for; to import it takes a second.
_IMPORTED = (
    "teleop_drake.sweep.run",
    "teleop_drake.tasks.metrics",
    "llvmlite.binding",
)


class WorkerProcesses(Executor):
    """Calls functions in processes of its own, each recycled after some calls.

    Other than in a ProcessPoolExecutor the death of a process is the failure of the
    one call that it was busy with: a RuntimeError that says how it ended. The next
    call gets a new process. Processes end with the one that started them, however
    that ends, and are not interrupted by Ctrl-C, which is for their owner to handle.

    On Linux they are forks of a server that has imported the package once and stays,
    idle, as long as the process that uses it.

    A script must keep its own work under `if __name__ == "__main__":`, because Python
    imports it in each process (a notebook need not).

    Args:
        jobs: Number of processes, >= 1.
        calls_per_process: After how many calls a process is replaced, >= 1.

    Raises:
        ValueError: If jobs or calls_per_process is less than 1.
    """

    def __init__(self, jobs: int, *, calls_per_process: int = CALLS_PER_PROCESS):
        for name, value in (("jobs", jobs), ("calls_per_process", calls_per_process)):
            CheckNumber(name, value, minimum=1)
        self._calls_per_process = calls_per_process
        # Each thread looks after one process, and starts it with Ctrl-C blocked.
        self._threads = ThreadPoolExecutor(jobs, initializer=_BlockInterrupts)
        self._local = threading.local()
        self._lock = threading.Lock()
        self._workers: set[_Worker] = set()
        self._is_closed = False

    def submit(
        self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs
    ) -> Future[_T]:
        """Schedules a call; its function, arguments and result must be picklable."""
        return self._threads.submit(self._Call, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes.

        Args:
            wait: Whether to return only when all is over.
            cancel_futures: Whether to cancel the calls that wait and to kill the
                processes that are busy. Else all calls are finished first.
        """
        if cancel_futures:
            with self._lock:
                self._is_closed = True
                for worker in self._workers:
                    worker.process.kill()
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        if wait:
            for worker in list(self._workers):
                self._Stop(worker)

    def _Call(self, fn: Callable[..., _T], args: Any, kwargs: Any) -> _T:
        worker: _Worker | None = getattr(self._local, "worker", None)
        if worker is not None and worker.num_calls >= self._calls_per_process:
            self._Stop(worker)
            worker = None
        if worker is None:
            worker = self._local.worker = self._Start()
        worker.num_calls += 1
        try:
            worker.connection.send((fn, args, kwargs))
            is_good, result = worker.connection.recv()
        except (EOFError, ConnectionError):
            self._local.worker = None
            raise RuntimeError(
                f"the worker process ended ({self._Stop(worker)})"
            ) from None
        if not is_good:
            raise result
        return cast(_T, result)

    def _Start(self) -> "_Worker":
        with self._lock:
            if self._is_closed:
                raise BrokenExecutor("the worker processes are shut down")
            try:
                worker = _Worker()
            except RuntimeError as error:
                # Python refuses it while a process still imports the script.
                raise BrokenExecutor(str(error)) from None
            self._workers.add(worker)
        try:
            worker.connection.recv()
        except (EOFError, ConnectionError):
            raise BrokenExecutor(
                f"a worker process could not start ({self._Stop(worker)}); a script "
                'must keep its own work under `if __name__ == "__main__":`'
            ) from None
        return worker

    def _Stop(self, worker: "_Worker") -> str:
        """Ends a process, which is idle or dead, and returns how it ended."""
        worker.connection.close()
        with self._lock:
            worker.process.join()
            self._workers.discard(worker)
        code = worker.process.exitcode
        if code is None or code >= 0:
            return f"exit code {code}"
        return f"killed by signal {-code}"


class _Worker:
    """A process and this end of the pipe to it."""

    def __init__(self) -> None:
        context = _StartContext()
        self.connection, other_end = context.Pipe()
        self.process = context.Process(
            target=_Serve, args=(other_end, dict(os.environ)), daemon=True
        )
        self.process.start()
        # So that its death closes the pipe.
        other_end.close()
        self.num_calls = 0


def _StartContext() -> Any:
    """Returns what starts processes.

    This process may have threads, which a fork would not survive. The server has
    imported what runs need, and done nothing else.
    """
    if sys.platform != "linux":  # macOS forbids much after a fork.
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(_IMPORTED))
    return context


def _BlockInterrupts() -> None:
    # This helper of multiprocessing, started on demand, would unblock them again.
    resource_tracker.ensure_running()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _Serve(connection: Connection, environment: dict[str, str]) -> None:
    """Answers calls until the other end of the pipe is closed.

    Args:
        environment: Of the process that started this one. A server may have another.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.environ.clear()
    os.environ.update(environment)
    threading.Thread(target=_EndWithParent, daemon=True).start()
    connection.send("ready")
    while True:
        try:
            fn, args, kwargs = connection.recv()
            reply = (True, fn(*args, **kwargs))
        except EOFError:
            return
        except BaseException as error:
            reply = (False, error)
        try:
            connection.send(reply)
        except Exception as error:  # What cannot be pickled.
            connection.send((False, RuntimeError(f"{type(error).__name__}: {error}")))


def _EndWithParent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
