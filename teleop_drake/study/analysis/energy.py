"""Energy between the operator's hand and the tool.

F_h . v_felt goes in and F_c . v comes out. The balance includes the channels and both
sides of the architecture, and therefore the energy that the sides dissipate or store,
for example in the handle of P+d.
"""

from dataclasses import dataclass

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.numerics.step_polynomials import integrate_product
from teleop_drake.model.task_recording import CheckTaskRecording, TaskRecording


@dataclass(frozen=True, kw_only=True, eq=False)
class EnergyBalance:
    """The energy that a system with two ends has taken in over a run.

    Attributes:
        time: Times of the recording in s (N).
        energy: Integral of the power in minus the power out, J, 0 at the start (N).
    """

    time: Array
    energy: Array

    @property
    def violation(self) -> Array:
        """The energy in J that was generated between the ends up to each time (N).

        It is the largest deficit so far, and 0 as long as the system is passive.
        """
        return np.maximum.accumulate(np.maximum(-self.energy, 0.0))


def TwoPortEnergyBalance(recording: TaskRecording) -> EnergyBalance:
    """Balances the energy between the operator's hand and the tool of a recorded run.

        power in = F_h . v_felt,    power out = F_c . v

    It is valid for every architecture.

    Raises:
        ValueError: If the recording is not that of a teleoperation.
    """
    CheckTaskRecording("recording", recording)
    v_felt = recording.felt_velocity
    if v_felt is None or "forward_packet_sent" not in recording:
        Refuse("recording", "without packets", "a run of a teleoperation")
    time = recording.time
    steps = recording.steps
    F_c = recording["control_force"]
    v = recording["tool_velocity"]
    F_h = recording.commands[:, : v.shape[1]]
    shares = integrate_product(F_h[steps], v_felt[steps])
    shares -= integrate_product(F_c[steps], v[steps])
    length = time[steps[:, -1:]] - time[steps[:, :1]]
    work = np.zeros(len(time))
    work[steps[:, 1:]] = length * shares.sum(axis=2)
    return EnergyBalance(time=time, energy=np.cumsum(work))
