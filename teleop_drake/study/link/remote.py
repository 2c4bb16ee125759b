"""Runs one side of a loop over a real network in this process."""

from collections.abc import Callable
from pathlib import Path

from teleop_drake.model.scenario import ScenarioLike
from teleop_drake.model.scenario.loading import CheckScenarioLike
from teleop_drake.study.link.half import Driver
from teleop_drake.study.link.packets import OpenSocket, ReadKey
from teleop_drake.study.link.side import Say, Side


def OperateRemotely(
    scenario: ScenarioLike,
    *,
    connect: str,
    key: str,
    period: float = 0.001,
    limit: float = 0.5,
    fade: float = 0.1,
    patience: float = 5.0,
    say: Callable[[str], None] = Say,
    step: Driver | None = None,
    log_file: Path | None = None,
) -> Side:
    """Runs the operator's side: the operator, the device and the master side.

    Args:
        scenario: The scenario of the whole loop.
        connect: HOST:PORT of the robot's side.
        key: A file that `serve --new-key FILE` wrote, the same on both sides.
        period: See Side for this argument and all that follow.

    Returns:
        The side after its end, with Recording(), Report() and measured.Delays().

    Raises:
        ConnectionError: If the two sides have not been connected.
    """
    CheckScenarioLike(scenario)
    end, address = OpenSocket(connect, listens=False)
    with end:
        side = Side(
            scenario,
            "operator",
            ReadKey(key),
            end,
            address,
            period=period,
            limit=limit,
            fade=fade,
            patience=patience,
            say=say,
            step=step,
            log_file=log_file,
        )
        return side.Run()


def ServeRobot(
    scenario: ScenarioLike,
    *,
    listen: str,
    key: str,
    period: float = 0.001,
    limit: float = 0.5,
    fade: float = 0.1,
    patience: float = 5.0,
    say: Callable[[str], None] = Say,
    step: Driver | None = None,
    log_file: Path | None = None,
) -> Side:
    """Runs the robot's side; waits until OperateRemotely() calls.

    Args:
        scenario: The scenario of the whole loop.
        listen: HOST:PORT at which the side receives packets.
        key: A file that `serve --new-key FILE` wrote, the same on both sides.
        period: See Side for this argument and all that follow.

    Returns:
        The side after its end, with Recording(), Report() and measured.Delays().

    Raises:
        ConnectionError: If the two sides have not been connected.
    """
    CheckScenarioLike(scenario)
    end, _ = OpenSocket(listen, listens=True)
    with end:
        side = Side(
            scenario,
            "robot",
            ReadKey(key),
            end,
            period=period,
            limit=limit,
            fade=fade,
            patience=patience,
            say=say,
            step=step,
            log_file=log_file,
        )
        host, port = end.getsockname()[:2]
        side.Say(f"listening at {host}:{port}")
        return side.Run()
