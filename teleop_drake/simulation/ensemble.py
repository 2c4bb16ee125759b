"""An ensemble: teleoperators that differ in their delays only, in one Diagram."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from teleop_drake.channels.transport_delays import TransportDelays
from teleop_drake.environments.layered_force_field import LayeredForceField
from teleop_drake.robots import MakeRobot
from teleop_drake.scenario import CONTROLLERS, ChannelConfig, Scenario, ScenarioError
from teleop_drake.scenario.tree import ToTree
from teleop_drake.simulation.stale_cache_guard import AddStaleCacheGuard
from teleop_drake.stations import MakeControlLaw, MakeMasterStation, MakeSlaveStation
from teleop_drake.teleoperator import ConnectTeleoperator

_CHANNELS = ("forward_channel", "return_channel")


def CheckEnsemble(scenarios: Sequence[Scenario]) -> None:
    """Checks that scenarios can be one ensemble.

    Args:
        scenarios: Valid ones.

    Raises:
        ScenarioError: If there is none, or one has another controller than the
            thesis's two, or a channel that is not an exact transport delay, or they
            differ in more than their delays (and the longest step, which follows
            them).
    """
    if not scenarios:
        raise ScenarioError("scenarios = []: must have at least one member")
    for scenario in scenarios:
        if not isinstance(scenario, Scenario):
            raise ScenarioError("scenarios: must be teleoperations, not a tracking")
        kind = scenario.controller.kind
        if kind not in CONTROLLERS:
            raise ScenarioError(
                f"controller.kind = {kind!r}: must be one of {', '.join(CONTROLLERS)} "
                "in an ensemble"
            )
        for name in _CHANNELS:
            channel: ChannelConfig = getattr(scenario, name)
            if channel.kind != "transport" or channel.delay == 0:
                raise ScenarioError(
                    f"{name} = {channel.kind} with a delay of {channel.delay:g} s: "
                    "must be transport with a delay > 0 in an ensemble"
                )
    first = _WithoutDelays(scenarios[0])
    for scenario in scenarios[1:]:
        other = _WithoutDelays(scenario)
        for key, value in first.items():
            if other[key] != value:
                raise ScenarioError(
                    f"{key}: must be the same for all members of an ensemble, which "
                    "may differ in their delays only"
                )


def _WithoutDelays(scenario: Scenario) -> dict[str, object]:
    """Returns the fields of a scenario that the members of an ensemble share."""
    tree: dict[str, object] = {}
    for key, value in ToTree(scenario).items():
        if isinstance(value, dict):
            tree |= {f"{key}.{name}": x for name, x in value.items()}
        else:
            tree[key] = value
    for key in (*(f"{name}.delay" for name in _CHANNELS), "simulator.max_step_size"):
        del tree[key]
    return tree


def MakeEnsemble(scenarios: Sequence[Scenario]) -> Diagram:
    """Makes an ensemble: six systems as in MakeTeleoperator, for all its members.

    And a StaleCacheGuard.

    It is the teleoperator of Fig. 2.1 with signals M times as wide: each is that of the
    first member, then that of the second, and so on. A packet has the first half of
    all, and then the second half of all. What the members do does not depend on the
    others.

    Args:
        scenarios: M valid scenarios that differ in their delays only, each with one of
            the thesis's controllers and exact transport delays > 0.

    Returns:
        The Diagram, named `ensemble`. Its default context is the start.

    Raises:
        ScenarioError: If a scenario is not valid, or they cannot be one ensemble.
    """
    for scenario in scenarios:
        scenario.Validate()
    CheckEnsemble(scenarios)
    M, scenario = len(scenarios), scenarios[0]
    n, config = scenario.num_axes, scenario.robot
    at_rest = np.zeros(M * n)
    start = np.tile(config.start, M)

    def MakeChannel(name: str, initial_value: np.ndarray) -> TransportDelays:
        delays = [getattr(member, name).delay for member in scenarios]
        # Both halves of a packet.
        return TransportDelays(
            delays=np.tile(np.repeat(delays, n), 2).tolist(),
            initial_value=initial_value.tolist(),
        )

    builder = DiagramBuilder()
    # Here, because each level of Diagrams costs time for every state, of which an
    # ensemble has many.
    AddStaleCacheGuard(builder)
    for name, system in (
        ("master", MakeMasterStation(scenario, num_members=M)),
        (
            "forward_channel",
            MakeChannel("forward_channel", np.concatenate((at_rest, at_rest))),
        ),
        ("controller", MakeSlaveStation(MakeControlLaw(scenario, num_members=M))),
        (
            "robot",
            MakeRobot(
                model=config.model,
                start=config.start,
                elbow=config.elbow,
                mass=config.mass,
                damping=config.damping,
                num_members=M,
            ),
        ),
        (
            "environment",
            LayeredForceField(
                layers=scenario.environment.layers, num_axes=n, num_members=M
            ),
        ),
        (
            "return_channel",
            MakeChannel("return_channel", np.concatenate((start, at_rest))),
        ),
    ):
        builder.AddNamedSystem(name, system)
    ConnectTeleoperator(builder)
    ensemble = builder.Build()
    ensemble.set_name("ensemble")
    return ensemble


def MemberSignals(
    times: np.ndarray,
    signals: dict[str, np.ndarray],
    *,
    member: int,
    num_members: int,
    crossings: Sequence[float],
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Returns the times and signals of a member out of those of an ensemble.

    A jump of another member leaves no trace: a second row for the same time is left
    out if it only repeats the first one.

    Args:
        times: (N,) times in s.
        signals: (N, M k) samples by name.
        member: Which one, 0 to M - 1.
        num_members: M.
        crossings: When the member crossed a border, in s. There its signals may have
            a kink, and both rows stay.
    """
    own: dict[str, np.ndarray] = {}
    for name, x in signals.items():
        num_parts = 2 if "_packet_" in name else 1
        parts = x.reshape(len(x), num_parts, num_members, -1)
        own[name] = parts[:, :, member].reshape(len(x), -1)
    is_new = np.append(True, times[1:] > times[:-1]) | np.isin(times, crossings)
    for x in own.values():
        is_new[1:] |= (x[1:] != x[:-1]).any(axis=1)
    return times[is_new], {name: x[is_new] for name, x in own.items()}
