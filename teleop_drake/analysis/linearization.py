"""Linear models of both ends of the loop, taken from the live diagram.

The teleoperator is cut at its channels by fixing what they deliver. What lies between
two cuts, the master on one side and controller, robot and environment on the other, is
linearised by differences of the diagram's own time derivatives and outputs: no
transfer function is written down here.

Where. The operating point is in general a motion, not an equilibrium: the tool moves
through the tissue with the velocity that the surgeon commands. The model is that of
the instant. Nothing drifts in it: neither the pose nor the force of a spring that the
motion keeps stretching. What it says of modes slower than the motion itself is of no
use: an arm that passes the point in a second has no mode of 0.1 rad/s there.

Coordinates. Off an equilibrium the linear model depends on the coordinates of the
state. The robot's are taken to be position and velocity of its tool, r and v, in which
(2.6) is written; then dr/dt = v also between small deviations, exactly, as the surgeon
feels it. In joint coordinates it would not be: v = J(q) dq/dt.

Accuracy. numerics.differences takes the differences and estimates their error. The
longest step is a fiftieth of the way to the nearest surface: no difference
crosses one.

Frozen states. The estimates of an adaptive law (W1, Psi, W3) are held at the values of
the operating point, the initial ones or those of a run, and are no states of the
model. F_c is one. What the law computes from the estimates' rates stays in.

Passivity controllers (PassivityMaster, PassivitySlave) are taken to be idle: their
budgets are held at an amount that nothing near the point uses up, and are no states.
What is left is a linear law; once they act there is no such model.

Any other law that bends at the operating point is refused: the slopes on both sides
are compared. One that switches near it is modelled on the side on which the point
lies, and whoever linearises it has to know that.

Delays inside. A TransportDelay within a station is a cut like the channels: what it
delivers becomes an input of the model and what it gets an output.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram

from teleop_drake.analysis.cut_diagram import (
    Concatenate,
    FixedInput,
    InnerDelay,
    Leaves,
    SetStates,
    States,
)
from teleop_drake.analysis.linear_models import LoopModel, TwoPortModel
from teleop_drake.analysis.operating_point import OperatingPoint
from teleop_drake.architectures.adaptive_backstepping import AdaptiveBackstepping
from teleop_drake.architectures.time_domain_passivity import (
    PassivityMaster,
    PassivitySlave,
)
from teleop_drake.architectures.wave_variables import WaveSlave
from teleop_drake.channels.transport import TransportDelay
from teleop_drake.contexts import ContextsIn
from teleop_drake.environments.surface import CONTACT, SurfacesOf
from teleop_drake.numerics.differences import differentiate
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.operators import Surgeon
from teleop_drake.operators.modes import ModalOperator
from teleop_drake.scenario import Scenario
from teleop_drake.teleoperator import MakeTeleoperator

Array = NDArray[np.float64]

# The longest step of a difference, as a share of the way to the nearest border.
_STEP_SHARE = 1 / 50

# The least path in m and speed in m/s that lengths of steps derive from: shorter steps
# would drown in rounding.
_LEAST_SCALE = 1e-3

# What is closer than this to a border, in m, is at it.
_LEAST_DISTANCE = 1e-9

# Steps of forces and of states without a scale, in their SI units.
_STEP = 0.1

# Where the model is looked at again, as shares of the way to the nearest border.
_DRIFT_SHARES = (1 / 2, -1 / 2, 1 / 8, -1 / 8, 1 / 50, -1 / 50)

# Slopes on both sides that differ by more than this share of the largest are a bend.
_BEND = 1e-4

# Energy that leaves a budget of a passivity controller ample, in units of E_0.
_AMPLE = 1e9


def LinearizeLoop(
    scenario: Scenario,
    point: OperatingPoint,
    *,
    teleoperator: Diagram | None = None,
) -> LoopModel:
    """Linearises both ends of the loop at an operating point.

    The surgeon is in velocity mode; one who closes the loop is part of it, as
    OperatorConfig.MakeLinearOperator() says. Unless the point has a forward packet, the
    forces in it, and the states of the controller that are not frozen, are chosen such
    that the tool keeps its velocity: what the surgeon's device would have settled to.

    Args:
        scenario: A valid one.
        point: The operating point.
        teleoperator: The Diagram, made by MakeTeleoperator for this scenario, with
            systems of your own perhaps; None makes the scenario's.

    Raises:
        ValueError: If the robot's state is not as large as position and velocity of
            its tool, a system at either end has a state that is not continuous (a
            filter of samples), a law bends at the point, the point is at a border of a
            layer, or the robot cannot be there.
    """
    diagram = teleoperator or MakeTeleoperator(
        scenario,
        operator=scenario.surgeon.MakeLinearOperator(
            start=scenario.robot.start, contact_surface=scenario.FindSurface(CONTACT)
        ),
    )
    linearizer = _Linearizer(scenario, point, diagram)
    model = linearizer.Linearize()
    speed = float(np.linalg.norm(point.velocity))
    if speed == 0:
        return model
    # The model a little farther on, or, where there is none, less far or behind.
    for share in _DRIFT_SHARES:
        time = share * linearizer.BorderDistance() / speed
        position = point.position + time * point.velocity
        try:
            other = _Linearizer(
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
    scenario: Scenario,
    point: OperatingPoint,
    *,
    teleoperator: Diagram | None = None,
) -> TwoPortModel:
    """Linearises what is between the surgeon's hand and the environment.

    As LinearizeLoop, at the same forces and velocities. It does not depend on who
    holds the device.

    Args:
        scenario: A valid one.
        point: The operating point.
        teleoperator: As for LinearizeLoop.

    Raises:
        ValueError: As LinearizeLoop.
    """
    diagram = teleoperator or MakeTeleoperator(
        scenario, operator=Surgeon(velocity=scenario.surgeon.velocity)
    )
    return _Linearizer(scenario, point, diagram).LinearizeTwoPort()


# A model and the estimated error of each of its entries.
_Side = tuple[StateSpace, StateSpace]


class _Linearizer:
    """Holds the diagram with its channels cut."""

    def __init__(self, scenario: Scenario, point: OperatingPoint, diagram: Diagram):
        self._scenario = scenario
        self._point = point
        self._contexts = ContextsIn(diagram, diagram.CreateDefaultContext())
        self._systems = {x.get_name(): x for x in diagram.GetSystems()}
        self._surfaces = SurfacesOf(self._systems["environment"]) or ()
        self._frozen_weights = self._idle_passivity = False
        self._delays: dict[str, list[InnerDelay]] = {"master": [], "controller": []}
        self._plant = self._FindStates("robot")
        self._controller = self._FindStates("controller")
        self._environment = self._FindStates("environment")
        self._master = self._FindStates("master")
        self._forward_packet = self._Fix(("controller", "forward_packet"))
        self._return_packet = self._Fix(("master", "return_packet"))
        n = scenario.num_axes
        self._n = n
        num_states = sum(len(states.indices) for states in self._plant)
        if len(self._plant) != 1 or num_states != 2 * n:
            raise ValueError(
                f"robot: {num_states} states; allowed: {2 * n}, as many as position "
                "and velocity of its tool have"
            )

    def Linearize(self) -> LoopModel:
        """Returns the model of the loop, as if the operating point were at rest."""
        (master, master_error), (slave, slave_error), residual = (
            self._SettleAndLinearize()
        )
        return LoopModel(
            point=self._point,
            master=master,
            slave=slave,
            frozen_weights=self._frozen_weights,
            idle_passivity=self._idle_passivity,
            packet_sizes=self._PacketSizes(),
            inner_delays=self._InnerDelays(),
            error=max(
                _RelativeError(master, master_error), _RelativeError(slave, slave_error)
            ),
            master_error=master_error,
            slave_error=slave_error,
            master_drift=_Zero(master),
            slave_drift=_Zero(slave),
            trim_residual=residual,
        )

    def LinearizeTwoPort(self) -> TwoPortModel:
        """Returns the model between the hand and the environment."""
        # It settles with the environment and the haptic device.
        self._SettleAndLinearize()
        force = self._Fix(
            ("robot", "environment_force"), ("controller", "environment_force")
        )
        force.Set(self._Eval("environment", "environment_force"))
        slave, slave_error = self._LinearizeSlave(
            [force],
            [lambda: self._Eval("robot", "tool_velocity")],
            self._plant + self._controller,
        )
        surgeon, device = (
            self._systems["master"].GetSubsystemByName(name)
            for name in ("surgeon", "haptic_device")
        )
        if not isinstance(surgeon, ModalOperator) or surgeon.num_continuous_states():
            raise ValueError(
                f"surgeon: {type(surgeon).__name__}; allowed: an operator without "
                "dynamics, because the two-port ends at the hand"
            )
        contexts = [self._contexts[x] for x in (surgeon, device)]
        hand = FixedInput(
            ports=[surgeon.GetInputPort("haptic_force")], contexts=contexts[:1]
        )
        hand.Set(hand.Get())
        felt = device.GetInputPort("felt_velocity")
        master, master_error = self._LinearizeMaster(
            [hand],
            [lambda: felt.Eval(contexts[1])],
            [states for states in self._master if states.context is not contexts[1]],
        )
        return TwoPortModel(
            point=self._point,
            master=master,
            slave=slave,
            idle_passivity=self._idle_passivity,
            packet_sizes=self._PacketSizes(),
            inner_delays=self._InnerDelays(),
            error=max(
                _RelativeError(master, master_error), _RelativeError(slave, slave_error)
            ),
        )

    # The diagram.

    def _Fix(self, *ports: tuple[str, str]) -> FixedInput:
        systems = [self._systems[system] for system, _ in ports]
        return FixedInput(
            ports=[
                x.GetInputPort(name)
                for x, (_, name) in zip(systems, ports, strict=True)
            ],
            contexts=[self._contexts[x] for x in systems],
        )

    def _Eval(self, system: str, port: str) -> Array:
        output = self._systems[system].GetOutputPort(port)
        value: Array = output.Eval(self._contexts[self._systems[system]])
        return value

    def _PacketSizes(self) -> tuple[int, int]:
        forward, back = self._forward_packet.ports[0], self._return_packet.ports[0]
        return forward.size(), back.size()

    def _InnerDelays(self) -> tuple[float, ...]:
        delays = self._delays["master"] + self._delays["controller"]
        return tuple(x.delay for x in delays for _ in range(x.size))

    def _FindStates(self, name: str) -> list[States]:
        result = []
        for system in Leaves(self._systems[name]):
            context = self._contexts[system]
            size = context.num_continuous_states()
            # The environment's is the layer it is in.
            is_sampled = context.num_discrete_state_groups() > 0
            is_sampled &= name != "environment" and not isinstance(
                system, ModalOperator
            )
            is_sampled |= context.num_abstract_states() > 0
            if isinstance(system, TransportDelay) and name in self._delays:
                if system.delay > 0:
                    self._delays[name].append(InnerDelay(system, context))
            elif is_sampled:
                raise ValueError(
                    f"{name}: {system.get_name()!r} has a state that is not "
                    "continuous; allowed: continuous states only, for a linear model"
                )
            if isinstance(system, AdaptiveBackstepping):
                # [F_c, W1, Psi, W3]: F_c stays.
                size = system.GetOutputPort("control_force").size()
                self._frozen_weights = True
                if self._point.estimates is not None:
                    context.SetContinuousState(self._point.estimates)
            elif isinstance(system, PassivityMaster | PassivitySlave):
                # [E_in, E_out]: nothing has left.
                energies = np.zeros(size)
                energies[size // 2 :] = -_AMPLE
                context.SetContinuousState(energies)
                size = 0
                self._idle_passivity = True
            elif isinstance(system, WaveSlave) and system.drift_correction:
                raise ValueError(
                    f"{name}: drift_correction = {system.drift_correction:g}: must be "
                    "0 for a linear model, because it acts in one direction only"
                )
            if size:
                result.append(
                    States(system=system, context=context, indices=np.arange(size))
                )
        return result

    def _PassedSurfaces(self) -> list[bool]:
        p_WT = self._Eval("robot", "tool_position")
        return [bool(surface.Depth(p_WT) >= 0) for surface in self._surfaces]

    # The operating point.

    def _SettleAndLinearize(self) -> tuple[_Side, _Side, float]:
        """Returns master and slave, each with its error, and the rates that remain."""
        self._PlaceTool()
        self._forward_packet.Set(np.zeros(self._forward_packet.ports[0].size()))
        self._SettleDelays("controller")
        self._return_packet.Set(self._Eval("controller", "return_packet"))
        self._SettleDelays("master")
        self._forward_packet.Set(self._Eval("master", "forward_packet"))
        master, master_error = self._LinearizeMaster([], [], self._master)
        if self._point.forward_packet is None:
            # What the master sends whatever it feels, a velocity command say, stays.
            size = self._PacketSizes()[0]
            depends = np.hstack([master.C, master.D])[:size]
            residual = self._Trim(np.flatnonzero(np.any(depends != 0, axis=1)))
        else:
            self._forward_packet.Set(self._point.forward_packet)
            residual = float(np.abs(self._Rates()[self._n :]).max())
        slave, slave_error = self._LinearizeSlave([], [], self._SlaveStates())
        return (master, master_error), (slave, slave_error), residual

    def _SettleDelays(self, name: str) -> None:
        """Lets the delays inside deliver what goes into them now."""
        for delay in self._delays[name]:
            delay.Set(delay.GetInput())

    def _PlaceTool(self) -> None:
        """Sets the joints to the operating point."""
        (plant,) = self._plant
        point = self._point
        q = self._scenario.robot.JointPositions(point.position)
        n = self._n
        columns = []
        for rates in np.eye(n):
            plant.Set(np.concatenate([q, rates]))
            columns.append(self._Eval("robot", "tool_velocity"))
        reached = self._Eval("robot", "tool_position")
        if not np.allclose(reached, point.position, rtol=0, atol=1e-6):
            raise ValueError(
                f"robot: its tool must be at {point.position.tolist()} with the joint "
                f"positions that its config gives, and is at {reached.tolist()}"
            )
        self._jacobian = np.array(columns).T
        plant.Set(np.concatenate([q, np.linalg.solve(self._jacobian, point.velocity)]))

    def _SlaveStates(self) -> list[States]:
        return self._plant + self._controller + self._environment

    def _Rates(self) -> Array:
        """Returns the time rates of [r, v, the other states of the slave]."""
        return Concatenate(
            [
                self._Eval("robot", "tool_velocity"),
                self._Eval("robot", "tool_acceleration"),
                *(states.GetRates() for states in self._SlaveStates()[1:]),
            ]
        )

    def _Trim(self, free: NDArray[np.int_]) -> float:
        """Chooses free entries of the packet and the controller's state.

        Returns:
            The largest rate that remains.
        """
        n, m = self._n, len(free)
        packet, others = self._forward_packet, self._SlaveStates()[1:]
        packet_0 = packet.Get()

        def Residual(unknown: Array) -> Array:
            values = packet_0.copy()
            values[free] = unknown[:m]
            packet.Set(values)
            SetStates(others, unknown[m:])
            self._SettleDelays("controller")
            return self._Rates()[n:]

        unknown = Concatenate([packet_0[free], *(x.Get() for x in others)])
        steps = _STEP * np.maximum(1.0, np.abs(unknown))
        for _ in range(10):
            residual = Residual(unknown)
            if not len(unknown):
                break
            slope, _, _ = differentiate(Residual, unknown, steps)
            change = np.linalg.lstsq(slope, -residual, rcond=1e-10)[0]
            unknown = unknown + change
            if np.abs(change).max() <= 1e-12 * max(1.0, float(np.abs(unknown).max())):
                break
        return float(np.abs(Residual(unknown)).max())

    # The models.

    def _LinearizeSlave(
        self,
        inputs: Sequence[FixedInput],
        outputs: Sequence[Callable[[], Array]],
        states: Sequence[States],
    ) -> _Side:
        passed = self._PassedSurfaces()

        def Motion() -> Array:
            if self._PassedSurfaces() != passed:
                raise RuntimeError("a difference crosses a surface")
            names = ("tool_position", "tool_velocity", "tool_acceleration")
            return np.concatenate([self._Eval("robot", name) for name in names])

        gap = self.BorderDistance()
        speed = float(np.linalg.norm(self._scenario.surgeon.velocity))
        speed = max(speed, _LEAST_SCALE)
        per_joint = np.linalg.norm(self._jacobian, axis=0)
        return self._LinearizeSide(
            "controller",
            [*inputs, self._forward_packet],
            [*outputs, lambda: self._Eval("controller", "return_packet")],
            states,
            motion=Motion,
            steps=[_STEP_SHARE * gap / per_joint, speed / per_joint],
        )

    def _LinearizeMaster(
        self,
        inputs: Sequence[FixedInput],
        outputs: Sequence[Callable[[], Array]],
        states: Sequence[States],
    ) -> _Side:
        return self._LinearizeSide(
            "master",
            [*inputs, self._return_packet],
            [*outputs, lambda: self._Eval("master", "forward_packet")],
            states,
        )

    def _LinearizeSide(
        self,
        name: str,
        inputs: Sequence[FixedInput],
        outputs: Sequence[Callable[[], Array]],
        states: Sequence[States],
        *,
        motion: Callable[[], Array] | None = None,
        steps: Sequence[Array] = (),
    ) -> _Side:
        """Returns the model of one side, delays inside behind the rest, and its error.

        Args:
            name: Whose delays.
            inputs: What is set.
            outputs: What is seen.
            states: Those of the model.
            motion: [r, v, dv/dt], of which [r, v] take the place of the first states.
            steps: The longest steps of the first states.
        """
        delays = self._delays[name]
        ins: list[FixedInput | InnerDelay] = [*inputs, *delays]
        outs = [*outputs, *(delay.GetInput for delay in delays)]
        others = states[1:] if motion else states
        x0 = Concatenate([x.Get() for x in states])
        u0 = Concatenate([x.Get() for x in ins])
        ends = np.cumsum([len(x.Get()) for x in ins])[:-1]
        size = len(x0)

        def Evaluate() -> Array:
            moved = motion() if motion else np.zeros(0)
            return Concatenate(
                [
                    moved[: 2 * self._n],
                    *(x.Get() for x in others),
                    moved[self._n :],
                    *(x.GetRates() for x in others),
                    *(Output() for Output in outs),
                ]
            )

        def OfState(x: Array) -> Array:
            SetStates(states, x)
            return Evaluate()

        def OfInput(u: Array) -> Array:
            for port, value in zip(ins, np.split(u, ends), strict=True):
                port.Set(value)
            return Evaluate()

        known = sum(map(len, steps))
        x_steps = Concatenate([*steps, _STEP * np.maximum(1.0, np.abs(x0[known:]))])
        by_x, error_x, bend_x = differentiate(OfState, x0, x_steps)
        SetStates(states, x0)
        by_u, error_u, bend_u = differentiate(OfInput, u0, np.full(len(u0), _STEP))
        OfInput(u0)
        for bend, slope in ((bend_x, by_x), (bend_u, by_u)):
            if bend.size and bend.max() > _BEND * np.abs(slope).max():
                raise ValueError(
                    f"{name}: its law bends at the operating point "
                    f"{self._point.name!r}, as one that switches there; allowed: a law "
                    "with one linear model"
                )
        # The coordinates are a function of the state: d/d(coordinates).
        to_coordinates = np.linalg.inv(by_x[:size])
        by_z = by_x[size:] @ to_coordinates
        error_z = error_x[size:] + np.abs(by_z) @ error_x[:size]
        error_z = error_z @ np.abs(to_coordinates)
        model, error = (
            StateSpace(A=z[:size], B=u[:size], C=z[size:], D=u[size:])
            for z, u in ((by_z, by_u[size:]), (error_z, error_u[size:]))
        )
        return model, error

    def BorderDistance(self) -> float:
        """Returns how far it is to the nearest border, at most the task's path.

        A path of less than a millimetre says nothing of how the robot bends.
        """
        p_WT = self._point.position
        distance = min(
            (abs(float(surface.Depth(p_WT))) for surface in self._surfaces),
            default=math.inf,
        )
        if distance < _LEAST_DISTANCE:
            raise ValueError(
                f"position = {p_WT[0]:g}: must not be the border of a layer, where the "
                "environment has no linear model"
            )
        path = self._scenario.duration * float(
            np.linalg.norm(self._scenario.surgeon.velocity)
        )
        return min(distance, max(path, _LEAST_SCALE), 1.0)


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


def _Zero(model: StateSpace) -> StateSpace:
    return StateSpace(A=0 * model.A, B=0 * model.B, C=0 * model.C, D=0 * model.D)


def _RelativeError(model: StateSpace, error: StateSpace) -> float:
    """Returns the largest error relative to the largest entry of its matrix."""
    parts = [
        (np.vstack([model.A, model.C]), np.vstack([error.A, error.C])),
        (np.vstack([model.B, model.D]), np.vstack([error.B, error.D])),
    ]
    return max(
        float(doubt.max() / max(np.abs(matrix).max(), 1e-300))
        for matrix, doubt in parts
        if matrix.size
    )
