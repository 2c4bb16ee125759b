"""Linear models of both ends of the loop, taken from the live diagram.

The teleoperator is cut at its channels by fixing what they deliver. What lies between
two cuts, the master on one side and controller, robot and environment on the other, is
linearised by differences of the diagram's own time derivatives and outputs: no
transfer function is written down here.

Where. The operating point is in general a motion, not an equilibrium: the tool moves
through the tissue with the velocity that the operator commands. The model is that of
the instant. Nothing drifts in it: neither the pose nor the force of a spring that the
motion keeps stretching. What it says of modes slower than the motion itself is of no
use: an arm that passes the point in a second has no mode of 0.1 rad/s there.

Coordinates. Off an equilibrium the linear model depends on the coordinates of the
state. The robot's are taken to be position and velocity of its tool, r and v, in which
(2.6) is written; then dr/dt = v also between small deviations, exactly, as the operator
feels it. In joint coordinates it would not be: v = J(q) dq/dt. Joints beyond the task
axes, which can move while the tool stays where it is, add coordinates of their own
(analysis.tool_motion).

Accuracy. numerics.differences takes the differences and estimates their error. The
longest step is a fiftieth of the way to the nearest surface: no difference
crosses one.

Frozen states. The estimates of an adaptive law (W1, Psi, W3) are held at the values of
the operating point, the initial ones or those of a run, and are no states of the
model. F_c is one. What the law computes from the estimates' rates stays in.

Passivity controllers are taken to be idle: their budgets are held at an amount that
nothing near the point uses up, and are no states. What is left is a linear law; once
they act there is no such model.

Any other law that bends at the operating point is refused: the slopes on both sides
are compared. One that switches near it is modelled on the side on which the point
lies, and whoever linearises it has to know that.

Delays inside. A constant delay within a station is a cut like the channels: what it
delivers becomes an input of the model and what it gets an output.

What is frozen, idle or a delay, the blocks themselves tell (linear_part).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram

from teleop_drake.analysis.linear_models import LoopModel, TwoPortModel
from teleop_drake.analysis.linearizer import Linearizer
from teleop_drake.analysis.operating_point import OperatingPoint
from teleop_drake.environments import CONTACT
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.operators import Surgeon
from teleop_drake.scenario import AsTeleoperation, ScenarioLike
from teleop_drake.teleoperator import MakeTeleoperator

Array = NDArray[np.float64]

# Where the model is looked at again, as shares of the way to the nearest surface.
_DRIFT_SHARES = (1 / 2, -1 / 2, 1 / 8, -1 / 8, 1 / 50, -1 / 50)


def MakeLinearTeleoperator(scenario: ScenarioLike) -> Diagram:
    """Makes the scenario's diagram, with the operator of a linear analysis.

    Args:
        scenario: A valid one, or its name or file.
    """
    scenario = AsTeleoperation(scenario)
    return MakeTeleoperator(
        scenario,
        operator=scenario.surgeon.MakeLinearOperator(
            start=scenario.robot.start, contact_surface=scenario.FindSurface(CONTACT)
        ),
    )


def LinearizeLoop(
    scenario: ScenarioLike,
    point: OperatingPoint,
    *,
    teleoperator: Diagram | None = None,
) -> LoopModel:
    """Linearises both ends of the loop at an operating point.

    The operator commands a velocity, or holds a force if the point says so; one who
    closes the loop is part of it, as OperatorConfig.MakeLinearOperator() says. Unless
    the point has a forward packet, the forces in it, and the states of the controller
    that are not frozen, are chosen such that the tool keeps its velocity: what the
    operator's device would have settled to.

    Args:
        scenario: A valid one.
        point: The operating point.
        teleoperator: The Diagram, made by MakeTeleoperator for this scenario, with
            systems of your own perhaps; None makes the scenario's.

    Raises:
        ScenarioError: If the robot's state is not that of as many joints as there are
            task axes or more, the operator does not tell which force it would hold, a
            system at either end has a state that is not continuous (a filter of
            samples), a law bends at the point, the point is on a surface, or the robot
            cannot be there.
    """
    scenario = AsTeleoperation(scenario)
    diagram = teleoperator or MakeLinearTeleoperator(scenario)
    linearizer = Linearizer(scenario, point, diagram)
    model = linearizer.Linearize()
    speed = float(np.linalg.norm(point.velocity))
    if speed == 0:
        return model
    # The model a little farther on, or, where there is none, less far or behind.
    for share in _DRIFT_SHARES:
        time = share * linearizer.SurfaceDistance() / speed
        position = point.position + time * point.velocity
        try:
            other = Linearizer(
                scenario, replace(point, position=position), diagram
            ).Linearize()
        except ValueError:
            if share == _DRIFT_SHARES[-1]:
                raise
            continue
        break
    return replace(
        model,
        master_drift=_Drift(model.master, other.master, model.master_error, time),
        slave_drift=_Drift(model.slave, other.slave, model.slave_error, time),
    )


def LinearizeTwoPort(
    scenario: ScenarioLike,
    point: OperatingPoint,
    *,
    teleoperator: Diagram | None = None,
) -> TwoPortModel:
    """Linearises what is between the operator's hand and the environment.

    As LinearizeLoop, at the same forces and velocities. It does not depend on who
    holds the device.

    Args:
        scenario: A valid one.
        point: The operating point.
        teleoperator: As for LinearizeLoop.

    Raises:
        ScenarioError: As LinearizeLoop.
    """
    scenario = AsTeleoperation(scenario)
    diagram = teleoperator or MakeTeleoperator(
        scenario, operator=Surgeon(velocity=scenario.surgeon.velocity)
    )
    return Linearizer(scenario, point, diagram).LinearizeTwoPort()


def _Drift(
    model: StateSpace, other: StateSpace, error: StateSpace, time: float
) -> StateSpace:
    """Returns the rate of each entry, per s, as far as it is not due to its error."""

    def Rate(one: Array, two: Array, doubt: Array) -> Array:
        change = two - one
        return np.where(np.abs(change) > 2 * doubt, change, 0.0) / time

    return StateSpace(
        A=Rate(model.A, other.A, error.A),
        B=Rate(model.B, other.B, error.B),
        C=Rate(model.C, other.C, error.C),
        D=Rate(model.D, other.D, error.D),
    )
