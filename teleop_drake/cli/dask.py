"""The executor of a Dask cluster, for the option --dask."""

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from teleop_drake.cli.exit_codes import BadInput
from teleop_drake.cli.progress import Notice


@contextmanager
def DaskExecutor(address: str | None) -> Iterator[Executor | None]:
    """Yields the executor of the Dask cluster at an address; None without an address.

    If the cluster has no workers yet, a line on stderr reports it.

    Raises:
        BadInput: If there is no scheduler at the address, or Dask is not installed.
    """
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise BadInput(
            f"--dask = {address!r}: must be left out, or the package distributed "
            "installed (pip install 'teleop-drake[dask]')"
        ) from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise BadInput(
            f"--dask = {address!r}: must be the address of a Dask scheduler ({error})"
        ) from None
    with client:
        if not client.scheduler_info()["workers"]:
            Notice(
                f"{address} has no workers; the runs wait for the first one (dask "
                f"worker {address}). Ctrl-C ends the sweep"
            )
        # With Dask's default, pure=True, calls with equal arguments would run once.
        yield client.get_executor(pure=False)
