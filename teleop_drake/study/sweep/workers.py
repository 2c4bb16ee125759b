"""Worker processes on this machine, as an executor that replaces dead processes."""

import multiprocessing
import os
import queue
import signal
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from typing import Any

# A process is replaced after so many calls. In Drake before 1.56 a simulation leaks two
# megabytes: a Diagram with a LeafSystem written in Python is never freed.
_CALLS_PER_PROCESS = 100

_NO_START = (
    "a worker process could not start; a script must keep its own work under "
    '`if __name__ == "__main__":`'
)


class Workers(Executor):
    """A pool of processes, each of which is served by a thread of this process.

    If a process dies, only the future of its present call raises a ChildProcessError.
    If a process cannot start, the future raises a BrokenExecutor.

    On Linux the processes are forks of a server, which has imported the modules that
    calls need and lives as long as this process. They are not forks of this process,
    because its threads would not survive a fork. On macOS each process is started
    anew, because much is forbidden after a fork.

    Args:
        jobs: Number of processes.
        preload: The module that the server imports.
    """

    def __init__(self, jobs: int, preload: str):
        kind = "forkserver" if sys.platform == "linux" else "spawn"
        self._context = multiprocessing.get_context(kind)
        self._context.set_forkserver_preload([preload, "llvmlite.binding"])
        self._threads = ThreadPoolExecutor(jobs)
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        self._workers: set[Worker] = set()

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> "Future[Any]":
        """Schedules a call; see concurrent.futures.Executor."""
        return self._threads.submit(self._Do, partial(fn, *args, **kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes, at once if calls are cancelled; see Executor."""
        self._threads.shutdown(wait=False, cancel_futures=cancel_futures)
        if cancel_futures:
            for worker in list(self._workers):
                worker.process.kill()
        self._threads.shutdown(wait=wait)
        for worker in list(self._workers):
            self._End(worker)

    def _Do(self, call: Callable[[], Any]) -> Any:
        """Executes a call in an idle process, or in a new one."""
        try:
            worker = self._idle.get_nowait()
        except queue.Empty:
            worker = Worker(self._context)
            self._workers.add(worker)
        try:
            result = worker.Do(call)
        except (ChildProcessError, BrokenExecutor):
            self._End(worker)
            raise
        if worker.num_calls < _CALLS_PER_PROCESS:
            self._idle.put(worker)
        else:
            self._End(worker)
        return result

    def _End(self, worker: "Worker") -> None:
        self._workers.discard(worker)
        worker.End()


class Worker:
    """A process, and the connection over which it receives its calls.

    Args:
        context: The multiprocessing context, which starts the process.
        prepare: A function that the process calls first; None: none.
    """

    def __init__(self, context: BaseContext, prepare: Callable[[], None] | None = None):
        self.connection, other_end = context.Pipe()
        self.num_calls = 0
        arguments = (other_end, self.connection, dict(os.environ), prepare)
        self.process = context.Process(  # type: ignore[attr-defined]
            target=_Serve, args=arguments, daemon=True
        )
        try:
            self.process.start()
        except (AssertionError, OSError, RuntimeError) as error:
            raise BrokenExecutor(_NO_START) from error
        other_end.close()

    def Do(self, call: Callable[[], Any]) -> Any:
        """Returns the result of a call in the process."""
        if self.num_calls == 0:
            self._AwaitStart()
        self.num_calls += 1
        try:
            self.connection.send(call)
            result, error = self.connection.recv()
        except (EOFError, OSError):
            raise ChildProcessError("its process ended") from None
        if error is not None:
            raise error
        return result

    def End(self) -> None:
        """Closes the connection, which ends the process, and waits for the end."""
        self.connection.close()
        self.process.join()

    def _AwaitStart(self) -> None:
        try:
            self.connection.recv()
        except (EOFError, OSError):
            raise BrokenExecutor(_NO_START) from None


def _Serve(
    connection: Connection,
    other_end: Connection,
    environment: Mapping[str, str],
    prepare: Callable[[], None] | None,
) -> None:
    """Executes the calls from a connection until its other end is closed.

    The process takes over the parent's environment, and ignores Ctrl-C, which the
    parent handles.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.clear()
    os.environ.update(environment)
    other_end.close()  # A fork has a copy of it.
    if prepare is not None:
        prepare()
    try:
        connection.send("started")
        while True:
            call = connection.recv()
            result = error = None
            try:
                result = call()
            except BaseException as raised:  # noqa: BLE001 - The caller handles it.
                error = raised
            connection.send((result, error))
    except (EOFError, OSError):
        return
