"""Control architectures: what stands at the two ends of the channels.

An architecture is a master side, a slave side and what the channels deliver before the
first packet. Nothing else in the package knows which one it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import System

from teleop_drake.scenario import Scenario
from teleop_drake.stations import MakeControlLaw, MakeSlaveStation


@dataclass(kw_only=True)
class Architecture:
    """A master side and a slave side which understand each other's packets.

    The widths of the packets, m_f forward and m_r back, are those of the ports.

    Attributes:
        master_side: In haptic_force (n, N), velocity_command (n, m/s) and
            return_packet (m_r); out felt_position (n, m), felt_velocity (n, m/s) and
            forward_packet (m_f). The surgeon perceives contact when felt_position
            reaches the surface. None: the thesis's; see stations.MakeMasterStation.
        slave_side: In forward_packet (m_f), tool_position (n, m), tool_velocity
            (n, m/s) and environment_force (n, N); out control_force (n, N) and
            return_packet (m_r). Outputs beyond these, of either side, are recorded
            under their names.
        initial_forward_packet: What the slave side receives at first (m_f).
        initial_return_packet: What the master side receives at first (m_r).
    """

    master_side: System | None = None
    slave_side: System
    initial_forward_packet: Sequence[float]
    initial_return_packet: Sequence[float]


def MakeArchitecture(
    scenario: Scenario, *, control_law: System | None = None
) -> Architecture:
    """Makes the architecture that the scenario names.

    Args:
        scenario: Its field controller is used, and what its defaults derive from.
        control_law: A control law of your own, which takes the place of the
            scenario's; it gets the thesis's packets. See stations.MakeSlaveStation.

    Raises:
        ScenarioError: If a parameter is not allowed.
        RuntimeError: If the control law lacks a port.
    """
    # Neither a force nor a command at first, and the tool felt at rest at its start.
    n = scenario.num_axes
    start = np.asarray(scenario.robot.start, dtype=float).tolist()
    return Architecture(
        slave_side=MakeSlaveStation(control_law or MakeControlLaw(scenario)),
        initial_forward_packet=[0.0] * (2 * n),
        initial_return_packet=[*start, *[0.0] * n],
    )
