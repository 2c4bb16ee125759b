"""Linear models of a teleoperator's loop, computed from its Diagram.

The teleoperator is cut at its channels by fixing the packets that they deliver. The two
parts are the master, and the slave with controller, robot and environment. They are
evaluated in the Diagram that Drake converts to AutoDiffXd, so that the slopes are exact
and no transfer function is derived by hand. If a block does not convert, the slopes are
central differences, and LoopModel.by_differences contains the block's path.

Validity. The operating point is in general a motion, not an equilibrium: the tool moves
through the tissue with the commanded velocity. The model is that of an instant,
dx/dt = A(t) x with t held. A mode of this model is meaningful only if the model hardly
changes during the mode's motion. The derivative of the equation shows how fast the
model changes:

    x'' = A x' + A' x,    with solutions e^(z t) where det(z^2 I - z A - A') = 0.

If A changes slowly, each z is close to a root of A or smaller. For example, a single
root a that changes at the rate a' has z = a and z = -a'/a, the relative rate of the
root. A root of magnitude |s| is faster than the motion if no root crosses the circle of
radius |s| as the model changes within the time 1/|s|, that is among the models
A + h A'/|s| with |h| <= 1. MotionRate() returns the magnitude from which this holds. It
does not depend on units or coordinates, and is 0 if A is constant. A smaller root gives
no information on stability, because the tool moves on before the mode develops. Such
roots count as neutral.

Source: W. J. Rugh, "Linear System Theory", 2nd ed., Prentice Hall (1996), chapter 8, on
slowly varying systems.

Coordinates. Away from an equilibrium the linear model depends on the coordinates of the
state. The robot's coordinates are position r and velocity v of its tool, as in (2.6).
Then dr/dt = v also holds exactly between small deviations, as the operator feels it.
In joint coordinates it does not hold, because v = J(q) dq/dt. A robot with more joints
than task axes has further coordinates (analysis.tool_motion).

Frozen states. The estimates of an adaptive law (W1, Psi, W3) are held at the values of
the operating point, by default at their initial values, and are not states of the
model. F_c is a state. Terms that the law computes from the estimates' rates remain in
the model.

Passivity controllers are assumed to be idle. Their budgets are held at an ample amount
and are not states. The remaining law is linear. When the controllers act, there is no
such model.

Bends. Any other law whose slopes differ on both sides of the operating point is
refused. A law that switches near the point is modelled on the side on which the point
lies; the user must take this into account.

Inner delays. A constant delay within a station is cut like the channels: its output
becomes an input of the model, and its input becomes an output.

The blocks declare frozen states, idle controllers and delays (kernel.linear_part).
"""

import math
from dataclasses import replace
from itertools import chain

import numpy as np
from pydrake.systems.framework import Context, Diagram, System

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.framework.validation import Refuse, ScenarioError, Within
from teleop_drake.loops.kernel.linear_part import (
    FROZEN_WEIGHTS,
    IDLE_PASSIVITY,
    HeldForce,
    LinearPartOf,
)
from teleop_drake.loops.linear.cut_diagram import Cut, CutDiagram, Split, TimesOf
from teleop_drake.loops.linear.states import States
from teleop_drake.loops.numerics.state_space import StateSpace, close_loops
from teleop_drake.model.blocks.environments import CONTACT, SurfacesOf
from teleop_drake.model.blocks.operators import ConstantVelocityOperator
from teleop_drake.model.scenario import AsTeleoperation, Scenario, ScenarioLike
from teleop_drake.model.teleoperator import MakeTeleoperator
from teleop_drake.study.analysis.loop_model import (
    CutLoop,
    LoopModel,
    Motion,
    TwoPortModel,
)
from teleop_drake.study.analysis.loop_parts import (
    CutTeleoperator,
    ReadLoopBlocks,
    SignalsAt,
    StatesOf,
)
from teleop_drake.study.analysis.operating_point import OperatingPoint
from teleop_drake.study.analysis.tool_motion import ToolMotion

# The rate of the model is a central difference of models at two points on the path.
# This is their distance from the operating point as a share of the distance to the
# nearest surface.
_SHARE = 1e-2

# The longest step of central differences: relative to values of 1 and more, and as a
# share of the distance to the nearest surface. The smaller one counts.
_STEP = 1e-4
_STEP_SHARE = 1 / 50

# A point closer than this to a surface, in m, counts as on the surface.
_LEAST_DISTANCE = 1e-9

# Trimming by Newton's method: the largest number of steps, and the relative change
# below which it ends.
_MAX_TRIM_STEPS = 10
_TRIMMED = 1e-12


class Linearizer:
    """A scenario's teleoperator, cut open once for linear models at many points.

    The operator commands a velocity, or holds a force if the point's `holds_force` is
    set. An operator who closes the loop is part of the model; see
    OperatorConfig.MakeLinearOperator(). The forces in the forward packet, and the
    states of controller and environment that are not frozen, are trimmed such that the
    tool does not accelerate. These are the values to which the operator's device would
    settle.

    Attributes:
        diagram: The teleoperator.

    Args:
        scenario: A valid scenario, or its name or file.
        teleoperator: A Diagram made by MakeTeleoperator() for this scenario. It may
            contain your own systems. By default it is made from the scenario.
        at_ports: Whether the teleoperator is also cut at hand and tool, for TwoPort().

    Raises:
        ScenarioError: If the robot's state does not consist of the positions and
            velocities of at least as many joints as task axes, the operator does not
            declare the force that it holds, a system of either station has a state that
            is not continuous (a filter of samples), a law bends at the point, the point
            is on a surface, or the robot cannot reach it.
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
        # _root is the Context of the operating point. It is reset from _default.
        self._root = teleoperator.CreateDefaultContext()
        self._default = teleoperator.CreateDefaultContext()
        self._function = CutDiagram(teleoperator, self._root)
        self._contexts = self._function.contexts
        self._environment = teleoperator.GetSubsystemByName("environment")
        self._master = teleoperator.GetSubsystemByName("master")
        robot = teleoperator.GetSubsystemByName("robot")
        # The blocks of both stations declare their contributions to the model.
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
        # Trimming chooses the states of controller and environment, not the master's.
        self._chosen = StatesOf(blocks, "controller") + StatesOf(blocks, "environment")
        slave_states = [self._motion.states, *self._chosen]
        self._states = [*slave_states, *StatesOf(blocks, "master")]
        self._num_slave_states = sum(x.size for x in slave_states)
        self._num_states = sum(x.size for x in self._states)
        # The function of the model: from states and cuts to the rates, the signals that
        # enter the cuts, and the robot's ports for the change of coordinates.
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
        """The force that the operator holds after contact, if it declares one."""
        return self._holding and self._holding.described.held_force

    def Loop(self, point: OperatingPoint) -> LoopModel:
        """Returns the model of the loop at an operating point, including its motion."""
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
        """Returns the model of the loop at an operating point, without its motion."""
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

    def ContextAt(self, point: OperatingPoint) -> Context:
        """Returns the Context of the teleoperator at an operating point."""
        self._Linearize(point)
        return self._root.Clone()

    def TwoPort(self, point: OperatingPoint) -> TwoPortModel:
        """Returns the model between hand and environment; requires `at_ports`."""
        system, _ = self._Linearize(point)
        n = self._scenario.num_axes
        num_signals = self._num_signals
        delayed = np.arange(2 * n, num_signals)
        # After the signals, the outputs are the tool's position, velocity and
        # acceleration and the felt velocity.
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
            The model from the signals delivered at the cuts to the signals that enter
            there and the observed ports, and the largest rate that remains after
            trimming.
        """
        self._Settle(point)
        step = min(_STEP, _STEP_SHARE * self._SurfaceDistance(point))
        values, slopes = self._Trim(step)
        bent = self._function.Bends(slopes)
        if bent:
            raise ScenarioError(
                f"teleoperator = a law that bends at the operating point "
                f"{point.name!r}, as one that switches there, in "
                f"{next(iter(bent.values()))!r}: must have one linear model"
            )
        N = self._num_states
        num_joint_states = self._motion.states.size
        coordinates, rates = self._motion.Coordinates(
            slopes[:num_joint_states], slopes[N + self._num_signals :]
        )
        slopes[:num_joint_states] = rates
        # Slopes by the state become slopes by the coordinates, which are a function of
        # the state.
        by_state = np.eye(N)
        by_state[:num_joint_states] = coordinates[:, :N]
        by_coordinates = slopes[:, :N] @ np.linalg.inv(by_state)
        matrix = np.hstack([by_coordinates, slopes[:, N:]])
        model = StateSpace(matrix=matrix, num_states=N)
        return model, float(np.abs(values[self._StoppedRates()]).max())

    def _Settle(self, point: OperatingPoint) -> None:
        """Sets the Contexts to an operating point.

        Each cut is fixed at the signal that enters it, in the order from the tool to
        the forward packet.
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
        # The cuts settle twice, because the felt signals may come out of delays in the
        # master.
        for cut in (*to_master, *to_master, forward):
            cut.Settle()

    def _HoldForce(self) -> None:
        """Sets the operator's mode in which it holds a force."""
        if self._holding is None or self.held_force is None:
            allowed = "an operator that reports the force it holds after contact"
            Refuse("surgeon", self._scenario.surgeon.kind, allowed)
        self._contexts[self._holding.system].SetDiscreteState(self.held_force.state)

    def _Evaluate(self, step: float) -> tuple[Array, Array]:
        """Returns values and slopes after the cuts inside of the slave have settled."""
        for cut in (*self._cuts.hand, *self._cuts.tool, *self._cuts.inner_slave):
            cut.Settle()
        return self._function.Evaluate(step)

    def _StoppedRates(self) -> Indices:
        """Returns the rows of the rates that trimming sets to 0.

        They are the tool's acceleration and the rates of the chosen states.
        """
        n = self._scenario.num_axes
        acceleration = self._num_states + self._num_signals + 2 * n + np.arange(n)
        first = self._motion.states.size
        return np.r_[acceleration, first : self._num_slave_states]

    def _Trim(self, step: float) -> tuple[Array, Array]:
        """Chooses the forward packet and the states of controller and environment.

        Returns:
            Values and slopes as from CutDiagram.Evaluate().
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

        An entry of the packet that depends on no state or signal, such as a velocity
        command, does not change.
        """
        N = self._num_states
        rows = self._StoppedRates()
        first = self._motion.states.size
        packet = N + self._signals.forward
        columns = np.r_[first : self._num_slave_states, packet]
        # For trimming, the inner delays of the slave deliver their inputs, and the
        # environment is connected to the tool.
        closed = N + np.r_[self._signals.tool, self._signals.inner_slave]
        slope = close_loops(slopes, closed)[np.ix_(rows, columns)]
        is_free = np.ones(len(columns), dtype=bool)
        is_free[-len(packet) :] = np.any(slopes[packet] != 0, axis=1)
        change = np.zeros(len(columns))
        free = slope[:, is_free]
        change[is_free] = np.linalg.lstsq(free, -values[rows], rcond=1e-10)[0]
        return change

    def _SurfaceDistance(self, point: OperatingPoint) -> float:
        """Returns the distance in m to the nearest surface, at most 1 m.

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
        # The two-port does not depend on the operator.
        operator: System = ConstantVelocityOperator(velocity=scenario.surgeon.velocity)
    else:
        operator = scenario.surgeon.MakeLinearOperator(
            start=scenario.robot.start, contact_surface=scenario.FindSurface(CONTACT)
        )
    return MakeTeleoperator(scenario, operator=operator)
