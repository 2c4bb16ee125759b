"""A servo of Drake's blocks, which tests of pages share."""

import numpy as np
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem

from teleop_drake.loops import TransportDelay


def Servo(late=0.0):
    """A position that a controller without an integral holds on a spring.

    The measured state may be late, by a delay in s.
    """
    builder = DiagramBuilder()
    body = builder.AddNamedSystem(
        "body",
        LinearSystem(
            A=[[0, 1], [-1, -1]], B=[[0], [1]], C=np.eye(2), D=np.zeros((2, 1))
        ),
    )
    law = builder.AddNamedSystem("pid", PidController([49.0], [0.0], [15.0]))
    goal = builder.AddNamedSystem("goal", ConstantVectorSource([1.0, 0.0]))
    builder.Connect(goal.get_output_port(), law.get_input_port_desired_state())
    measured = body.get_output_port()
    if late:
        sensor = builder.AddNamedSystem("sensor", TransportDelay(late, 2))
        builder.Connect(measured, sensor.get_input_port())
        measured = sensor.get_output_port()
    builder.Connect(measured, law.get_input_port_estimated_state())
    builder.Connect(law.get_output_port(), body.get_input_port())
    builder.ExportOutput(body.get_output_port(), "state")
    return builder.Build()
