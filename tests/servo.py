"""A servo of Drake's blocks, which tests of pages share."""

import numpy as np
from pydrake.systems.controllers import PidController
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem
from wired import InSeries, Wired

from teleop_drake.loops import TransportDelay


def Servo(late=0.0):
    """A position that a controller without an integral holds on a spring.

    The measured state may be late, by a delay in s.
    """
    systems = {
        "body": LinearSystem(
            A=[[0, 1], [-1, -1]], B=[[0], [1]], C=np.eye(2), D=np.zeros((2, 1))
        ),
        "pid": PidController([49.0], [0.0], [15.0]),
        "goal": ConstantVectorSource([1.0, 0.0]),
    }
    connections = {"pid.desired_state": "goal", "body": "pid"}
    measured = ["body", "pid.estimated_state"]
    if late:
        systems["sensor"] = TransportDelay(late, 2)
        measured.insert(1, "sensor")
    connections |= InSeries(*measured)
    return Wired(systems, connections, {"state": "body"})
