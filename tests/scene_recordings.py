"""Recordings that need no simulation."""

import numpy as np

from teleop_drake.loops.run.recording import Event, SolverStatistics
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.task_recording import TaskRecording

NUMBERS = ("accuracy", "wall_time_s", "real_time_factor", "derivative_evaluations")
SOLVER = SolverStatistics(
    engine="drake", scheme="none", steps=100, **dict.fromkeys(NUMBERS, 1)
)
SPEED = 0.001
RETURN_DELAY = 0.2


def MakeRecording(name="one_dof", kind="direct_force", duration=2.0):
    """The tool goes at SPEED along x; it is felt RETURN_DELAY later."""
    delay = {"return_channel.delay": RETURN_DELAY, "duration": duration}
    scenario = LoadScenario(name, {"controller.kind": kind, **delay})
    t = np.linspace(0.0, duration, 101)
    start = scenario.robot.start
    along = np.eye(scenario.num_axes)[0]
    tool = start + SPEED * t[:, None] * along
    felt = start + SPEED * np.maximum(t - RETURN_DELAY, 0.0)[:, None] * along
    v = np.broadcast_to(SPEED * along, tool.shape)
    force = np.where(t[:, None] > 1.0, 0.01, 0.0) * along
    q = np.array([scenario.robot.JointPositions(p) for p in tool])
    return TaskRecording(
        scenario=scenario,
        time=t,
        signals={
            "tool_position": tool,
            "tool_velocity": v,
            "joint_position": q,
            "environment_force": force,
            "control_force": force,
            "forward_packet_received": np.hstack([0.5 * force, v]),
            "surgeon_mode": np.zeros((len(t), 1)),
            "return_packet_received": np.hstack([felt, v]),
            "forward_packet_sent": np.hstack([0.5 * force, v]),
        },
        events=[Event(name="contact", time=1.0)],
        solver=SOLVER,
        surfaces=scenario.Surfaces(),
    )
