"""A servo of Drake's blocks, which tests of pages share."""

import numpy as np
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem


def Servo():
    """A position that a controller without an integral holds on a spring."""
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
    builder.Connect(body.get_output_port(), law.get_input_port_estimated_state())
    builder.Connect(law.get_output_port(), body.get_input_port())
    builder.ExportOutput(body.get_output_port(), "state")
    return builder.Build()
