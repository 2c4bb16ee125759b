"""Runs one side of a loop over a real network in this process."""

from collections.abc import Callable
from pathlib import Path
from typing import TypedDict, Unpack

from teleop_drake.link.half import Driver
from teleop_drake.link.packets import OpenSocket, ReadKey
from teleop_drake.link.side import Side
from teleop_drake.scenario import ScenarioLike


class Options(TypedDict, total=False):
    """What Side takes besides its place and its key; Side has the defaults, too."""

    period: float
    limit: float
    fade: float
    patience: float
    say: Callable[[str], None]
    step: Driver | None
    log_file: Path | None


def OperateRemotely(
    scenario: ScenarioLike,
    *,
    connect: str,
    key: str,
    **options: Unpack[Options],
) -> Side:
    """Runs the operator's side: the operator, the device and the master side.

    Args:
        scenario: Of the whole loop.
        connect: HOST:PORT of the robot's side.
        key: A file that `serve --new-key FILE` wrote, the same on both sides.
        **options: See Options.

    Returns:
        The side after its end: its Recording(), Delays() and Report().

    Raises:
        ConnectionError: If the two sides have not met.
    """
    end, address = OpenSocket(connect, listens=False)
    with end:
        side = Side(
            scenario,
            "operator",
            ReadKey(key),
            end,
            address,
            **options,
        )
        return side.Run()


def ServeRobot(
    scenario: ScenarioLike,
    *,
    listen: str,
    key: str,
    **options: Unpack[Options],
) -> Side:
    """Runs the robot's side; waits until OperateRemotely() calls.

    Args:
        scenario: Of the whole loop.
        listen: HOST:PORT at which it is called.
        key: A file that `serve --new-key FILE` wrote, the same on both sides.
        **options: See Options.

    Returns:
        The side after its end: its Recording(), Delays() and Report().

    Raises:
        ConnectionError: If the two sides have not met.
    """
    end, _ = OpenSocket(listen, listens=True)
    with end:
        side = Side(
            scenario,
            "robot",
            ReadKey(key),
            end,
            **options,
        )
        host, port = end.getsockname()[:2]
        side.Say(f"listening at {host}:{port}")
        return side.Run()
