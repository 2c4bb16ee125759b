"""Linear models of both ends of the loop, taken from the live diagram.

The teleoperator is cut at its channels by fixing what they deliver. What lies between
two cuts, the master on one side and controller, robot and environment on the other, is
evaluated in the Diagram that Drake converts to AutoDiffXd: no transfer function is
written down here, and the slopes are exact. If a block does not convert, the slopes are
central differences, and LoopModel.by_differences names the block.

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
(analysis.tool_motion).

Frozen states. The estimates of an adaptive law (W1, Psi, W3) are held at the values of
the operating point, the initial ones unless it has others, and are no states of the
model. F_c is one. What the law computes from the estimates' rates stays in.

Passivity controllers are taken to be idle: their budgets are held at an amount that
nothing near the point uses up, and are no states. What is left is a linear law; once
they act there is no such model.

Any other law that bends at the operating point is refused: the slopes on both sides
are compared. One that switches near it is modelled on the side on which the point
lies, and whoever linearises it has to know that.

Delays inside. A constant delay within a station is a cut like the channels: what it
delivers becomes an input of the model and what it gets an output.

The blocks themselves describe what is frozen, idle or a delay (kernel.linear_part).
"""

import math
from dataclasses import replace
from itertools import chain

import numpy as np
from pydrake.systems.framework import Diagram, System

from teleop_drake.analysis.cut_diagram import Cut, CutDiagram, Split, States, TimesOf
from teleop_drake.analysis.loop_model import (
    CutLoop,
    LoopModel,
    Motion,
    TwoPortModel,
)
from teleop_drake.analysis.loop_parts import (
    CutTeleoperator,
    ReadLoopBlocks,
    SignalsAt,
    StatesOf,
)
from teleop_drake.analysis.operating_point import OperatingPoint
from teleop_drake.analysis.tool_motion import ToolMotion
from teleop_drake.arrays import Array, Indices
from teleop_drake.blocks.environments import CONTACT, SurfacesOf
from teleop_drake.blocks.operators import ConstantVelocityOperator
from teleop_drake.kernel.linear_part import (
    FROZEN_WEIGHTS,
    IDLE_PASSIVITY,
    HeldForce,
    LinearPartOf,
)
from teleop_drake.numerics.state_space import StateSpace, close_loops
from teleop_drake.scenario import AsTeleoperation, Scenario, ScenarioLike
from teleop_drake.teleoperator import MakeTeleoperator
from teleop_drake.validation import Refuse, ScenarioError, Within

# How far the operating point moves on, as a share of the way to the nearest surface,
# for the rate of the model: a central difference of exact models.
_SHARE = 1e-2

# Longest difference where slopes are differences: as a share of values of 1 and more,
# and of the way to the nearest surface.
_STEP = 1e-4
_STEP_SHARE = 1 / 50

# What is closer than this to a surface, in m, is on it.
_LEAST_DISTANCE = 1e-9

# Steps of Newton's method that choose the packet, and the relative change at its end.
_MAX_TRIM_STEPS = 10
_TRIMMED = 1e-12


class Linearizer:
    """A scenario's teleoperator, cut open once for the models at many points.

    The operator commands a velocity, or holds a force if the point has held contact; an
    operator who closes the loop is part of it, see OperatorConfig.MakeLinearOperator().
    The forces in the forward packet, and the states of the controller that are not
    frozen, are chosen such that the tool retains its velocity: what the operator's
    device would have settled to.

    Attributes:
        diagram: The teleoperator.

    Args:
        scenario: A valid one, or its name or file.
        teleoperator: The Diagram, made by MakeTeleoperator for this scenario, with
            systems of your own perhaps; None makes the scenario's.
        at_ports: Whether the model is that between hand and environment, TwoPort().

    Raises:
        ScenarioError: If the robot's state is not that of as many joints as there are
            task axes or more, the operator does not tell which force it would hold, a
            system at either end has a state that is not continuous (a filter of
            samples), a law bends at the point, the point is on a surface, or the robot
            cannot be there.
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        teleoperator: Diagram | None = None,
        *,
        at_ports: bool = False,
    ):
        self._scenario = AsTeleoperation(scenario)
        if teleoperator is None:
            teleoperator = _MakeTeleoperator(self._scenario, at_ports=at_ports)
        self.diagram = teleoperator
        self._root = teleoperator.CreateDefaultContext()
        self._default = teleoperator.CreateDefaultContext()
        self._function = CutDiagram(teleoperator, self._root)
        self._contexts = self._function.contexts
        self._environment = teleoperator.GetSubsystemByName("environment")
        self._master = teleoperator.GetSubsystemByName("master")
        robot = teleoperator.GetSubsystemByName("robot")
        blocks = ReadLoopBlocks(self._function)
        self._blocks = blocks
        self._holding = next((x for x in blocks if x.described.held_force), None)
        self._assumptions = {x.described.assumption for x in blocks}
        self._cuts = CutTeleoperator(
            teleoperator, self._function, blocks, at_ports=at_ports
        )
        self._signals = SignalsAt(self._cuts)
        self._motion = ToolMotion(
            config=self._scenario.robot,
            robot=robot,
            context=self._contexts[robot],
            states=StatesOf(blocks, "robot"),
            num_axes=self._scenario.num_axes,
        )
        # The states of controller and environment are chosen, the master's are not.
        self._chosen = StatesOf(blocks, "controller") + StatesOf(blocks, "environment")
        slave_states = [self._motion.states, *self._chosen]
        self._states = [*slave_states, *StatesOf(blocks, "master")]
        self._num_slave_states = sum(x.size for x in slave_states)
        self._num_states = sum(x.size for x in self._states)
        seen = self._motion.Seen()
        if at_ports:
            device = self._master.GetSubsystemByName("haptic_device")
            seen = [*seen, device.GetInputPort("felt_velocity")]
        cuts = list(chain.from_iterable(self._cuts))
        entering = [cut.entering for cut in cuts if cut.entering is not None]
        self._function.Choose(self._states, cuts, [*entering, *seen])
        self._num_signals = sum(len(cut.value) for cut in cuts)

    @property
    def held_force(self) -> HeldForce | None:
        """The force that the operator holds after contact, if it tells it."""
        return self._holding and self._holding.described.held_force

    def Loop(self, point: OperatingPoint) -> LoopModel:
        """Returns the model of the loop at an operating point, and of its motion."""
        model = self._AtRest(point)
        speed = float(np.linalg.norm(point.velocity))
        if speed == 0:
            return model
        time = _SHARE * self._SurfaceDistance(point) / speed
        behind, ahead = (
            CutLoop(self._AtRest(replace(point, position=point.position + way)))
            for way in (-time * point.velocity, time * point.velocity)
        )
        return replace(model, motion=Motion(behind=behind, ahead=ahead, time=2 * time))

    def _AtRest(self, point: OperatingPoint) -> LoopModel:
        """Returns the model of the loop as if the operating point were at rest."""
        system, residual = self._Linearize(point)
        signals = np.arange(self._num_signals)
        return LoopModel(
            point=point,
            system=system.part(np.arange(self._num_states), signals, signals),
            num_slave_states=self._num_slave_states,
            signals=self._signals,
            frozen_weights=FROZEN_WEIGHTS in self._assumptions,
            idle_passivity=IDLE_PASSIVITY in self._assumptions,
            inner_delays=TimesOf([*self._cuts.inner_slave, *self._cuts.inner_master]),
            motion=None,
            by_differences=self._function.by_differences,
            trim_residual=residual,
        )

    def TwoPort(self, point: OperatingPoint) -> TwoPortModel:
        """Returns the model between hand and environment; needs `at_ports`."""
        system, _ = self._Linearize(point)
        n = self._scenario.num_axes
        num_signals = self._num_signals
        delayed = np.arange(2 * n, num_signals)
        # Seen are the tool's position, velocity and acceleration and the felt velocity.
        _, tool_velocity, _, felt_velocity = num_signals + np.arange(4 * n).reshape(
            4, n
        )
        return TwoPortModel(
            system=system.part(
                states=np.arange(self._num_states),
                inputs=np.arange(num_signals),
                outputs=np.concatenate([felt_velocity, tool_velocity, delayed]),
            ),
            signals=self._signals,
            idle_passivity=IDLE_PASSIVITY in self._assumptions,
        )

    def _Linearize(self, point: OperatingPoint) -> tuple[StateSpace, float]:
        """Returns the model at an operating point, in the tool's coordinates.

        Returns:
            The model from what is delivered at the cuts to what enters there and what
            else is seen, and the largest rate that is left.
        """
        self._Settle(point)
        step = min(_STEP, _STEP_SHARE * self._SurfaceDistance(point))
        values, slopes = self._Trim(step)
        if self._function.Bends(slopes):
            raise ScenarioError(
                f"teleoperator = a law that bends at the operating point "
                f"{point.name!r}, as one that switches there: must have one "
                "linear model"
            )
        N = self._num_states
        num_joint_states = self._motion.states.size
        coordinates, rates = self._motion.Coordinates(
            slopes[:num_joint_states], slopes[N + self._num_signals :]
        )
        slopes[:num_joint_states] = rates
        # The coordinates are a function of the state: d/d(coordinates).
        by_state = np.eye(N)
        by_state[:num_joint_states] = coordinates[:, :N]
        by_coordinates = slopes[:, :N] @ np.linalg.inv(by_state)
        matrix = np.hstack([by_coordinates, slopes[:, N:]])
        model = StateSpace(matrix=matrix, num_states=N)
        return model, float(np.abs(values[self._StoppedRates()]).max())

    def _Settle(self, point: OperatingPoint) -> None:
        """Brings the Contexts to an operating point.

        Each cut is fixed at what enters it, from the tool to the forward packet.
        """
        self._root.SetTimeStateAndParametersFrom(self._default)
        if point.holds_force:
            self._HoldForce()
        for block in self._blocks:
            with Within(block.part):
                state = LinearPartOf(block.system, point.estimates).state
            if state is not None:
                self._contexts[block.system].SetContinuousState(state)
        self._motion.Place(point.position, point.velocity)
        cuts = self._cuts
        (forward,) = cuts.forward
        forward.Set(np.zeros_like(forward.value))
        to_master = [*cuts.hand, *cuts.tool, *cuts.inner_slave, *cuts.back]
        to_master += cuts.inner_master
        # Twice: what the hand feels may come out of the delays in the master.
        for cut in (*to_master, *to_master, forward):
            cut.Settle()

    def _HoldForce(self) -> None:
        """Gives the operator the mode in which it holds a force."""
        if self._holding is None or self.held_force is None:
            allowed = "an operator that tells which force it holds after contact"
            Refuse("surgeon", self._scenario.surgeon.kind, allowed)
        self._contexts[self._holding.system].SetDiscreteState(self.held_force.state)

    def _Evaluate(self, step: float) -> tuple[Array, Array]:
        """Returns values and slopes, once the cuts inside of the slave have settled."""
        for cut in (*self._cuts.hand, *self._cuts.tool, *self._cuts.inner_slave):
            cut.Settle()
        return self._function.Evaluate(step)

    def _StoppedRates(self) -> Indices:
        """Returns the rows of the rates that trimming stops.

        They are the tool's acceleration and the rates of the states that are chosen.
        """
        n = self._scenario.num_axes
        acceleration = self._num_states + self._num_signals + 2 * n + np.arange(n)
        first = self._motion.states.size
        return np.r_[acceleration, first : self._num_slave_states]

    def _Trim(self, step: float) -> tuple[Array, Array]:
        """Chooses the forward packet and the states that have a choice.

        Returns:
            Values and slopes, as CutDiagram.Evaluate().
        """
        chosen: list[States | Cut] = [*self._chosen, *self._cuts.forward]
        for _ in range(_MAX_TRIM_STEPS):
            values, slopes = self._Evaluate(step)
            change = self._NewtonStep(values, slopes)
            x = np.concatenate([entry.Get() for entry in chosen]) + change
            if np.abs(change).max() <= _TRIMMED * max(1.0, float(np.abs(x).max())):
                break
            for entry, value in zip(chosen, Split(chosen, x), strict=True):
                entry.Set(value)
        return values, slopes

    def _NewtonStep(self, values: Array, slopes: Array) -> Array:
        """Returns the change of [chosen states; forward packet] that stops the rates.

        An entry of the packet that does not depend on the master, such as a velocity
        command, does not change.
        """
        N = self._num_states
        rows = self._StoppedRates()
        first = self._motion.states.size
        packet = N + self._signals.forward
        columns = np.r_[first : self._num_slave_states, packet]
        # Delays deliver what goes into them, and the tool feels its environment.
        closed = N + np.r_[self._signals.tool, self._signals.inner_slave]
        slope = close_loops(slopes, closed)[np.ix_(rows, columns)]
        is_free = np.ones(len(columns), dtype=bool)
        is_free[-len(packet) :] = np.any(slopes[packet] != 0, axis=1)
        change = np.zeros(len(columns))
        free = slope[:, is_free]
        change[is_free] = np.linalg.lstsq(free, -values[rows], rcond=1e-10)[0]
        return change

    def _SurfaceDistance(self, point: OperatingPoint) -> float:
        """Returns how far it is to the nearest surface, at most 1 m.

        Raises:
            ScenarioError: If the point is on a surface.
        """
        surfaces = SurfacesOf(self._environment) or ()
        distances = [abs(float(x.Depth(point.position))) for x in surfaces]
        distance = min(distances, default=math.inf)
        if distance < _LEAST_DISTANCE:
            allowed = "off every surface of the environment, for a linear model"
            Refuse("position", point.position, allowed)
        return min(distance, 1.0)


def _MakeTeleoperator(scenario: Scenario, *, at_ports: bool) -> Diagram:
    """Makes the scenario's teleoperator with an operator that has a linear model."""
    if at_ports:
        # Who holds the device makes no difference to the two-port.
        operator: System = ConstantVelocityOperator(velocity=scenario.surgeon.velocity)
    else:
        operator = scenario.surgeon.MakeLinearOperator(
            start=scenario.robot.start, contact_surface=scenario.FindSurface(CONTACT)
        )
    return MakeTeleoperator(scenario, operator=operator)
