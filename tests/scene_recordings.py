"""Recordings that need no simulation."""

import numpy as np

from teleop_drake.recording import Event, Recording, SolverStatistics
from teleop_drake.scenario import LoadScenario

SOLVER = SolverStatistics(
    engine="drake",
    scheme="none",
    accuracy=1.0,
    steps=100,
    derivative_evaluations=0,
    wall_time_s=1.0,
    real_time_factor=1.0,
)
SPEED = 0.001
RETURN_DELAY = 0.2


def MakeRecording(name="one_dof", kind="direct_force", duration=2.0, **overrides):
    """The tool goes at SPEED along x; it is felt RETURN_DELAY later."""
    scenario = LoadScenario(
        name,
        {
            "controller.kind": kind,
            "return_channel.delay": RETURN_DELAY,
            "duration": duration,
            **overrides,
        },
    )
    n = scenario.num_axes
    t = np.linspace(0.0, duration, 101)
    along = np.eye(n)[0]
    start = scenario.robot.start
    tool = start + SPEED * t[:, None] * along
    felt = start + SPEED * np.maximum(t - RETURN_DELAY, 0.0)[:, None] * along
    v = np.broadcast_to(SPEED * along, tool.shape)
    force = np.where(t[:, None] > 1.0, 0.01, 0.0) * along
    joints = [scenario.robot.JointPositions(p) for p in tool]
    return Recording(
        scenario=scenario,
        time=t,
        signals={
            "tool_position": tool,
            "tool_velocity": v,
            "joint_position": np.array(joints),
            "environment_force": force,
            "control_force": force,
            "return_packet_received": np.hstack([felt, v]),
            "forward_packet_sent": np.hstack([0.5 * force, v]),
            "forward_packet_received": np.hstack([0.5 * force, v]),
            "surgeon_mode": np.zeros((len(t), 1)),
        },
        events=[Event(name="contact", time=1.0)],
        solver=SOLVER,
        surfaces=scenario.Surfaces(),
    )
