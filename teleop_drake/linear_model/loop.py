"""Linear models of both ends of the loop, taken from the live diagram.

The teleoperator is cut at its channels by fixing what they deliver. What lies between
two cuts, the master on one side and controller, robot and environment on the other, is
evaluated with Drake's AutoDiffXd: no transfer function is written down here, and the
slopes are exact. Only a block that does not convert to AutoDiffXd gets differences, and
LoopModel.by_differences names it.

Where. The operating point is in general a motion, not an equilibrium: the tool moves
through the tissue with the velocity that the operator commands. The model is that of
the instant, dx/dt = A(t) x with t held. What it says of a mode has a meaning as long as
the model stays what it is while the mode goes through its motion. The rate at which the
model moves follows from the derivative of that equation,

    x'' = A x' + A' x,    with solutions e^(z t) where det(z^2 I - z A - A') = 0.

Where A changes slowly, z is a root s of A, or smaller: a single root a that changes at
a rate a' has z = a and z = -a'/a, the rate at which the root itself changes. A root of
size |s| is faster than the motion if no model on the way, A + h A'/|s| with |h| <= 1,
has it moved there from 0; MotionRate() is the size from which on that holds. It does
not depend on units or coordinates, and is 0 if A is constant. A root that is smaller
says nothing about stability, because the tool is elsewhere before it shows, and counts
as neutral.

Source: W. J. Rugh, "Linear System Theory", 2nd ed., Prentice Hall (1996), chapter 8, on
slowly varying systems.

Coordinates. Off an equilibrium the linear model depends on the coordinates of the
state. The robot's are taken to be position and velocity of its tool, r and v, in which
(2.6) is written; then dr/dt = v also between small deviations, exactly, as the operator
feels it. In joint coordinates it would not be: v = J(q) dq/dt. Joints beyond the task
axes, which can move while the tool stays where it is, add coordinates of their own
(linear_model.tool_motion).

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

What is frozen, idle or a delay, the blocks themselves tell (kernel.linear_part).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram

from teleop_drake.environments import CONTACT
from teleop_drake.linear_model.linearizer import Linearizer
from teleop_drake.linear_model.loop_cut import CutLoop
from teleop_drake.linear_model.models import LoopModel, Motion, TwoPortModel
from teleop_drake.linear_model.operating_point import OperatingPoint
from teleop_drake.numerics.delay_margin import closed_loop_matrix
from teleop_drake.operators import ConstantVelocityOperator
from teleop_drake.scenario import AsTeleoperation, ScenarioLike
from teleop_drake.teleoperator import MakeTeleoperator

Array = NDArray[np.float64]

# How far the operating point moves on, as a share of the way to the nearest surface,
# for the rate of the model: a central difference of exact models.
_SHARE = 1e-2

# Entries that change by less, as a share of the largest, do not: rounding.
_ROUNDING = 1e-13

# Circles about 0 that are looked at: how many in a decade, how many decades below the
# fastest mode, and how many points on the upper half of each. What is slower than all
# circles is neutral in any case.
_NUM_CIRCLES = 6
_NUM_DECADES = 6
_NUM_ANGLES = 9


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
    time = _SHARE * linearizer.SurfaceDistance() / speed
    here, behind, ahead = (
        CutLoop(model),
        *(
            CutLoop(
                Linearizer(
                    scenario,
                    replace(point, position=point.position + t * point.velocity),
                    diagram,
                    linearizer.dual,
                ).Linearize()
            )
            for t in (-time, time)
        ),
    )
    # Of both ends, and of the loop that is closed without delay.
    rates = []
    for OfLoop in (lambda loop: loop.A, closed_loop_matrix):
        A, change = OfLoop(here), OfLoop(ahead) - OfLoop(behind)
        change[np.abs(change) <= _ROUNDING * np.abs(A).max(initial=0.0)] = 0.0
        rates.append(MotionRate(A, change / (2 * time)))
    motion = Motion(rate=max(rates), loops=(behind, ahead), time=2 * time)
    return replace(model, motion=motion)


def LinearizeTwoPort(
    scenario: ScenarioLike,
    point: OperatingPoint,
    *,
    teleoperator: Diagram | None = None,
) -> TwoPortModel:
    """Linearises what is between the operator's hand and the environment.

    As LinearizeLoop, at the same forces and velocities. It does not depend on who
    holds the device.

    Raises:
        ScenarioError: As LinearizeLoop.
    """
    scenario = AsTeleoperation(scenario)
    diagram = teleoperator or MakeTeleoperator(
        scenario, operator=ConstantVelocityOperator(velocity=scenario.surgeon.velocity)
    )
    return Linearizer(scenario, point, diagram).LinearizeTwoPort()


def MotionRate(A: Array, A_dot: Array) -> float:
    """Returns the size in 1/s below which the roots of A(t) are slower than its motion.

    It is the radius of the smallest circle about 0 on which no z is an eigenvalue of
    A + h A'/|z| with |h| <= 1: on which the spectral radius of (z I - A)^-1 A' is less
    than |z|. 0 if that is the first circle that is looked at.

    Args:
        A: (n, n), in 1/s.
        A_dot: A', its rate (n, n), in 1/s^2.
    """
    modes = np.linalg.eigvals(A).astype(complex)
    fastest = float(np.abs(modes).max(initial=0.0))
    if fastest == 0 or not np.any(A_dot):
        return 0.0
    exponents = np.linspace(-_NUM_DECADES, 0, _NUM_DECADES * _NUM_CIRCLES + 1)
    # The directions of the modes, too: none slips through between two points.
    angles = np.concatenate([np.linspace(0, np.pi, _NUM_ANGLES), np.angle(modes)])
    directions = np.exp(1j * angles)[:, None, None] * np.eye(len(A))
    for k, radius in enumerate(fastest * 10**exponents):
        try:
            moved = np.linalg.solve(radius * directions - A, A_dot)
        except np.linalg.LinAlgError:  # A root to the last digit.
            continue
        if np.abs(np.linalg.eigvals(moved)).max() < radius:
            return float(radius) if k else 0.0
    return fastest
