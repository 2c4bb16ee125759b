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

import math
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Diagram, InputPort, OutputPort, System

from teleop_drake.arrays import Array, Indices
from teleop_drake.compiler.flatten import Flatten
from teleop_drake.contexts import ContextsIn
from teleop_drake.environments import CONTACT, SurfacesOf
from teleop_drake.kernel.linear_part import (
    FROZEN_WEIGHTS,
    IDLE_PASSIVITY,
    HeldForce,
    LinearPartOf,
)
from teleop_drake.linear_model.autodiff_diagram import (
    AutoDiffDiagram,
    Cut,
    CutAtDelay,
    LeafPorts,
    States,
)
from teleop_drake.linear_model.loop_model import (
    CutLoop,
    LoopModel,
    Motion,
    MotionRate,
    Signals,
    TwoPortModel,
)
from teleop_drake.linear_model.operating_point import OperatingPoint
from teleop_drake.linear_model.tool_motion import ToolMotion
from teleop_drake.machine_code.compiled import Interpreted
from teleop_drake.numerics.delay_margin import closed_loop_matrix
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.operators import ConstantVelocityOperator
from teleop_drake.scenario import AsTeleoperation, ScenarioLike
from teleop_drake.teleoperator import MakeTeleoperator
from teleop_drake.validation import Refuse, ScenarioError, Within

_SLAVE = ("controller", "environment", "robot")
_PARTS = ("master", *_SLAVE)

# How far the operating point moves on, as a share of the way to the nearest surface,
# for the rate of the model: a central difference of exact models.
_SHARE = 1e-2

# Entries that change by less, as a share of the largest, do not: rounding.
_ROUNDING = 1e-13

# Longest difference of a block that does not convert: as a share of values of 1 and
# more, and of the way to the nearest surface.
_STEP = 1e-4
_STEP_SHARE = 1 / 50

# What is closer than this to a surface, in m, is on it.
_LEAST_DISTANCE = 1e-9


def FindHeldForce(system: System) -> tuple[System, HeldForce] | None:
    """Returns the block that holds a force after contact, and what it tells, if any."""
    for block in Flatten(system):
        held = LinearPartOf(block.system).held_force
        if held is not None:
            return block.system, held
    return None


class Linearizer:
    """A scenario's teleoperator, cut open once for the models at many points.

    The operator commands a velocity, or holds a force if the point says so; one who
    closes the loop is part of it, as OperatorConfig.MakeLinearOperator() says. Unless
    the point has a forward packet, the forces in it, and the states of the controller
    that are not frozen, are chosen such that the tool keeps its velocity: what the
    operator's device would have settled to.

    Args:
        scenario: A valid one, or its name or file.
        teleoperator: The Diagram, made by MakeTeleoperator for this scenario, with
            systems of your own perhaps; None makes the scenario's.

    Raises:
        ScenarioError: If the robot's state is not that of as many joints as there are
            task axes or more, the operator does not tell which force it would hold, a
            system at either end has a state that is not continuous (a filter of
            samples), a law bends at the point, the point is on a surface, or the robot
            cannot be there.
    """

    @Interpreted()  # There are too few calls to pay compiling.
    def __init__(
        self,
        scenario: ScenarioLike,
        teleoperator: Diagram | None = None,
        *,
        at_ports: bool = False,
    ):
        scenario = self._scenario = AsTeleoperation(scenario)
        if teleoperator is None:
            # Who holds the device makes no difference to the two-port.
            operator: System = ConstantVelocityOperator(
                velocity=scenario.surgeon.velocity
            )
            if not at_ports:
                operator = scenario.surgeon.MakeLinearOperator(
                    start=scenario.robot.start,
                    contact_surface=scenario.FindSurface(CONTACT),
                )
            teleoperator = MakeTeleoperator(scenario, operator=operator)
        diagram = self.diagram = teleoperator
        self._root = diagram.CreateDefaultContext()
        self._default = diagram.CreateDefaultContext()
        contexts = self._contexts = ContextsIn(diagram, self._root)
        self._systems = {x.get_name(): x for x in diagram.GetSystems()}
        self._surfaces = SurfacesOf(self._systems["environment"]) or ()
        blocks = Flatten(diagram)
        self._told = [
            (part, block.system)
            for block in blocks
            if (part := block.path.split("/")[0]) in _PARTS
        ]
        states: dict[str, list[States]] = {name: [] for name in _PARTS}
        inner: dict[str, list[Cut]] = {name: [] for name in _PARTS}
        self._inner_delays: list[float] = []
        self._assumptions: set[str] = set()
        for part, block in self._told:
            context = contexts[block]
            with Within(part):
                told = LinearPartOf(block)
            self._assumptions.add(told.assumption)
            if told.delay:
                cut = CutAtDelay(blocks, block, contexts)
                inner[part].append(cut)
                self._inner_delays += [told.delay] * len(cut.Get())
            is_sampled = context.num_discrete_state_groups() and not told.has_modes
            if told.delay is None and (is_sampled or context.num_abstract_states()):
                raise ScenarioError(
                    f"{part}.{block.get_name()} = a state that is not continuous: must "
                    "be continuous for a linear model"
                )
            size = told.num_states
            if size is None:
                size = context.num_continuous_states()
            if size:
                found = States(system=block, context=context, size=size)
                states[part].append(found)
        self._motion = ToolMotion(
            config=scenario.robot,
            robot=self._systems["robot"],
            states=states["robot"],
            num_axes=scenario.num_axes,
            evaluate=lambda name: self._Output("robot", name).Eval(
                self._contexts[self._systems["robot"]]
            ),
        )
        self._others = states["controller"] + states["environment"]
        self._inner_slave = [cut for name in _SLAVE for cut in inner[name]]
        self._inner_master = inner["master"]
        self._forward = self._Cut(
            self._Output("master", "forward_packet"),
            self._Input("controller", "forward_packet"),
        )
        self._back = self._Cut(
            self._Output("controller", "return_packet"),
            self._Input("master", "return_packet"),
        )
        self._delays = [
            self._forward, *self._inner_slave, self._back, *self._inner_master
        ]  # fmt: skip
        self._states = [self._motion.states, *self._others, *states["master"]]
        self._num_states = sum(x.size for x in self._states)
        self._num_slave_states = self._num_states - sum(
            x.size for x in states["master"]
        )
        self._ports: list[Cut] = []
        seen: list[InputPort | OutputPort] = list(self._motion.Seen())
        if at_ports:
            device = self._systems["master"].GetSubsystemByName("haptic_device")
            holder = self._systems["master"].GetSubsystemByName("surgeon")
            seen.append(device.GetInputPort("felt_velocity"))
            self._ports = [
                self._Cut(
                    device.GetOutputPort("haptic_force"),
                    holder.GetInputPort("haptic_force"),
                ),
                self._Cut(
                    self._Output("environment", "environment_force"),
                    self._Input("robot", "environment_force"),
                    self._Input("controller", "environment_force"),
                ),
            ]
        cuts = [*self._ports, *self._delays]
        ends = np.cumsum([0, *(len(cut.Get()) for cut in cuts)])
        self._signals = {cut: np.arange(*ends[i : i + 2]) for i, cut in enumerate(cuts)}
        self._num_signals = int(ends[-1])
        # The rows of the slopes are the rates of the states, what enters each cut, and
        # what is seen; the columns are the states and what is delivered at each cut.
        self._dual = AutoDiffDiagram(
            blocks,
            contexts,
            states=self._states,
            cuts=cuts,
            seen=[*(cut.entering for cut in cuts if cut.entering), *seen],
            parts=_PARTS,
        )

    def Loop(self, point: OperatingPoint) -> LoopModel:
        """Returns the model of the loop at an operating point, and of its motion."""
        model = self._AtRest(point, is_checked=True)
        speed = float(np.linalg.norm(point.velocity))
        if speed == 0:
            return model
        time = _SHARE * self._SurfaceDistance(point) / speed

        def LoopAt(t: float) -> StateSpace:
            position = point.position + t * point.velocity
            return CutLoop(self._AtRest(replace(point, position=position)))

        here, behind, ahead = CutLoop(model), LoopAt(-time), LoopAt(time)
        # Of both ends, and of the loop that is closed without delay.
        rates = []
        for OfLoop in (lambda loop: loop.A, closed_loop_matrix):
            A, change = OfLoop(here), OfLoop(ahead) - OfLoop(behind)
            change[np.abs(change) <= _ROUNDING * np.abs(A).max(initial=0.0)] = 0.0
            rates.append(MotionRate(A, change / (2 * time)))
        motion = Motion(rate=max(rates), loops=(behind, ahead), time=2 * time)
        return replace(model, motion=motion)

    def _AtRest(self, point: OperatingPoint, *, is_checked: bool = False) -> LoopModel:
        """Returns the model of the loop as if the operating point were at rest."""
        residual, slopes = self._Settle(point)
        system = self._System(point, slopes, is_checked=is_checked)
        every = np.arange(self._num_signals)
        return LoopModel(
            point=point,
            system=system.part(np.arange(self._num_states), every, every),
            num_slave_states=self._num_slave_states,
            signals=self._Signals(),
            frozen_weights=FROZEN_WEIGHTS in self._assumptions,
            idle_passivity=IDLE_PASSIVITY in self._assumptions,
            inner_delays=tuple(self._inner_delays),
            motion=None,
            by_differences=tuple(self._dual.by_differences),
            trim_residual=residual,
        )

    @Interpreted()
    def TwoPort(self, point: OperatingPoint) -> TwoPortModel:
        """Returns the model between hand and environment; needs `at_ports`."""
        _, slopes = self._Settle(point)
        system = self._System(point, slopes, is_checked=True)
        device = self._systems["master"].GetSubsystemByName("haptic_device")
        outside = {
            block.system
            for part in (self._systems["environment"], device)
            for block in Flatten(part)
        }
        inside = np.repeat(
            [x.system not in outside for x in self._states],
            [x.size for x in self._states],
        )
        n, num = self._scenario.num_axes, self._num_signals
        delayed = np.arange(2 * n, num)
        felt, v = num + 3 * n + np.arange(n), num + n + np.arange(n)
        return TwoPortModel(
            num_axes=n,
            system=system.part(
                np.flatnonzero(inside), np.arange(num), np.r_[felt, v, delayed]
            ),
            signals=self._Signals(),
            idle_passivity=IDLE_PASSIVITY in self._assumptions,
        )

    # The diagram.

    def _Output(self, system: str, port: str) -> OutputPort:
        return self._systems[system].GetOutputPort(port)

    def _Input(self, system: str, port: str) -> InputPort:
        return self._systems[system].GetInputPort(port)

    def _Cut(self, entering: OutputPort, *ports: InputPort) -> Cut:
        leaves = [leaf for port in ports for leaf in LeafPorts(port)]
        return Cut(ports=leaves, contexts=self._contexts, entering=entering)

    def _SignalsOf(self, *cuts: Cut) -> Indices:
        return np.concatenate(
            [np.zeros(0, dtype=int), *(self._signals[cut] for cut in cuts)]
        )

    def _Signals(self) -> Signals:
        """Returns which of the delayed signals pass which delay."""
        parts = ([self._forward], self._inner_slave, [self._back], self._inner_master)
        first = self._signals[self._forward][0]
        return Signals(*(self._SignalsOf(*cuts) - first for cuts in parts))

    # The operating point.

    def _Settle(self, point: OperatingPoint) -> tuple[float, Array]:
        """Brings the Contexts to an operating point.

        Returns:
            The largest rate that remains, and the slopes there.
        """
        self._root.SetTimeStateAndParametersFrom(self._default)
        if point.holds_force:
            held = FindHeldForce(self._systems["master"])
            if held is None:
                allowed = "an operator that tells which force it holds after contact"
                Refuse("surgeon", self._scenario.surgeon.kind, allowed)
            self._contexts[held[0]].SetDiscreteState(held[1].state)
        for part, block in self._told:
            with Within(part):
                state = LinearPartOf(block, point.estimates).state
            if state is not None:
                self._contexts[block].SetContinuousState(state)
        self._motion.Place(point.position, point.velocity)
        step = self._Step(point)
        self._forward.Set(0 * self._forward.Get())
        for delay in (*self._inner_slave, self._back, *self._inner_master):
            delay.Settle()
        self._forward.Settle()
        if point.forward_packet is not None:
            self._forward.Set(point.forward_packet)
        return self._Trim(step, is_chosen=point.forward_packet is None)

    def _Trim(self, step: float, *, is_chosen: bool) -> tuple[float, Array]:
        """Chooses free entries of the packet and the controller's state, or none."""
        others = self._others if is_chosen else []
        N, n = self._num_states, len(self._motion.states.Get())
        num_states = sum(x.size for x in others)
        acceleration = N + self._num_signals + 2 * self._scenario.num_axes
        rows = np.r_[
            acceleration : acceleration + self._scenario.num_axes,
            n : self._num_slave_states,
        ]
        columns = np.r_[n : n + num_states, N + self._SignalsOf(self._forward)]
        # Delays deliver what goes into them, and the tool feels its environment.
        closed = N + self._SignalsOf(*self._ports[1:], *self._inner_slave)
        for _ in range(10):
            for delay in self._inner_slave:
                delay.Settle()
            values, slopes = self._dual.Evaluate(step)
            rates = values[rows]
            # What the master sends whatever it feels, a velocity command say, stays.
            sent = slopes[N + self._signals[self._forward]]
            free = np.flatnonzero(np.any(sent != 0, axis=1) & is_chosen)
            chosen = np.r_[:num_states, num_states + free]
            if not len(chosen):
                break
            around = np.eye(len(closed)) - slopes[np.ix_(closed, closed)]
            inner = np.linalg.solve(around, slopes[np.ix_(closed, columns)])
            slope = slopes[np.ix_(rows, columns)] + slopes[np.ix_(rows, closed)] @ inner
            change = np.zeros(len(columns))
            change[chosen] = np.linalg.lstsq(slope[:, chosen], -rates, rcond=1e-10)[0]
            x = np.concatenate([*(x.Get() for x in others), self._forward.Get()])
            largest = max(1.0, float(np.abs((x + change)[chosen]).max()))
            if np.abs(change).max() <= 1e-12 * largest:
                break
            ends = np.cumsum([states.size for states in others])
            *parts, packet = np.split(x + change, ends)
            for states, part in zip(others, parts, strict=True):
                states.Set(part)
            self._forward.Set(packet)
        return float(np.abs(rates).max()), slopes

    def _SurfaceDistance(self, point: OperatingPoint) -> float:
        """Returns how far it is to the nearest surface, at most 1 m.

        Raises:
            ScenarioError: If the point is on a surface.
        """
        p_WT = point.position
        distances = [abs(float(surface.Depth(p_WT))) for surface in self._surfaces]
        distance = min(distances, default=math.inf)
        if distance < _LEAST_DISTANCE:
            allowed = "off every surface of the environment, for a linear model"
            Refuse("position", p_WT, allowed)
        return min(distance, 1.0)

    def _Step(self, point: OperatingPoint) -> float:
        return min(_STEP, _STEP_SHARE * self._SurfaceDistance(point))

    # The model.

    def _System(
        self, point: OperatingPoint, slopes: Array, *, is_checked: bool
    ) -> StateSpace:
        """Returns the model with these slopes, in the tool's coordinates.

        From what is delivered at the cuts to what enters there and what else is seen.
        """
        N = self._num_states
        if is_checked and self._dual.Bends(self._Step(point), slopes):
            raise ScenarioError(
                f"teleoperator = a law that bends at the operating point "
                f"{point.name!r}, as one that switches there: must have one "
                "linear model"
            )
        coordinates, rates = self._motion.Coordinates(
            slopes[: len(self._motion.states.Get())], slopes[N + self._num_signals :]
        )
        slopes[: len(rates)] = rates
        by_x = np.eye(N)
        by_x[: len(coordinates)] = coordinates[:, :N]
        # The coordinates are a function of the state: d/d(coordinates).
        of_x = slopes[:, :N] @ np.linalg.inv(by_x)
        of_u = slopes[:, N:]
        return StateSpace(A=of_x[:N], B=of_u[:N], C=of_x[N:], D=of_u[N:])
