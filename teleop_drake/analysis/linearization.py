"""Linear models of both ends of the loop, taken from the live diagram.

The teleoperator is cut at its channels by fixing what they deliver. What lies between
two cuts, the master on one side and controller, robot and environment on the other, is
linearised by differences of the diagram's own time derivatives and outputs: no
transfer function is written down here.

Where. The operating point is in general a motion, not an equilibrium: the tool moves
through the tissue with the velocity that the surgeon commands. The model is that of
the instant. Nothing drifts in it: neither the pose nor the force of a spring that the
motion keeps stretching.

Coordinates. Off an equilibrium the linear model depends on the coordinates of the
state. The robot's are taken to be position and velocity of its tool, r and v, in which
(2.6) is written; then dr/dt = v also between small deviations, exactly, as the surgeon
feels it. In joint coordinates it would not be: v = J(q) dq/dt.

Accuracy. Central differences with four steps, each half of the one before, are
extrapolated to step 0 (Richardson), which is exact for polynomials of degree 8. The
difference between the last two extrapolations is the estimate of the error. The
longest step is a fiftieth of the way to the nearest border of a layer: no difference
crosses one.

Frozen states. The estimates of an adaptive law (W1, Psi, W3) are held at the values of
the operating point, the initial ones or those of a run, and are no states of the
model. F_c is one. What the law computes from the estimates' rates stays in.

A law that switches has a model on either side of the switch and none at it. Whoever
linearises one has to know on which side the operating point lies.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram, InputPort, System

from teleop_drake.laws.layered_force import layer_index
from teleop_drake.laws.state_space import StateSpace
from teleop_drake.recording import Recording
from teleop_drake.robots import CheckRobot, InverseKinematics, TaskInertiaInverse
from teleop_drake.scenario import Scenario
from teleop_drake.systems.adaptive_backstepping import AdaptiveBackstepping
from teleop_drake.systems.surgeon import Surgeon
from teleop_drake.teleoperator import MakeTeleoperator

Array = NDArray[np.float64]

# The longest step of a difference, as a share of the way to the nearest border.
_STEP_SHARE = 1 / 50

# Steps of forces and of states without a scale, in their SI units.
_STEP = 0.1

_NUM_STEPS = 4

EMPTY = "empty"
"""What the space in front of the first layer is called."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingPoint:
    """Where the diagram is linearised.

    Attributes:
        name: What it is called.
        layer: Name of the layer that it is in, or EMPTY.
        position: p_WT in m (n).
        velocity: v_WT in m/s (n).
        forward_packet: What the forward channel delivers; None: what keeps the velocity
            constant.
        estimates: State of an adaptive law, [F_c, W1, Psi, W3] as in
            AdaptiveBackstepping; None: its initial estimates.
    """

    name: str
    layer: str
    position: Array
    velocity: Array
    forward_packet: Array | None = None
    estimates: Array | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopModel:
    """The loop, cut at its channels, at an operating point.

    Small deviations obey, with the delays T_f and T_r,

        return packet  = slave(s) forward packet(t - T_f)
        forward packet = master(s) return packet(t - T_r)

    Attributes:
        point: The operating point.
        master: From the return packet received to the forward packet sent.
        slave: From the forward packet received to the return packet sent. Its states
            are [r (n), v (n), the states of the controller that are not frozen].
        frozen_weights: Whether the estimates of an adaptive law are held constant.
        error: Estimated relative error of the matrices.
        trim_residual: Largest rate of the tool's velocity, in m/s^2, and of the
            controller's states: what no choice of the forward packet could remove, or,
            where the point has one, what it is.
    """

    point: OperatingPoint
    master: StateSpace
    slave: StateSpace
    frozen_weights: bool
    error: float
    trim_residual: float


def OperatingPoints(scenario: Scenario) -> list[OperatingPoint]:
    """Returns an operating point in each layer that the tool comes to.

    The path is the line on which the tool moves from its start with the commanded
    velocity, for the duration of the scenario, as far as the robot reaches and no
    farther than the contact surface. In each layer the point is halfway along. On the
    surface it is where the first impact is deepest: at rest, v_x sqrt(m/k) below, with
    the inertia m of the tool along x.

    Args:
        scenario: A valid one.
    """
    start = np.asarray(scenario.robot.start, dtype=float)
    velocity = np.asarray(scenario.surgeon.velocity, dtype=float)
    surface = scenario.contact_surface
    if velocity[0] <= 0:
        surface = None
    end_time = scenario.duration
    if surface is not None:
        end_time = min(end_time, (surface - start[0]) / velocity[0])
    end_time = _ReachableTime(scenario, start, velocity, end_time)
    borders = [0.0, end_time]
    if velocity[0] != 0:
        borders += [
            time
            for layer in scenario.environment.layers
            if 0 < (time := (layer.start - start[0]) / velocity[0]) < end_time
        ]
    times = sorted(borders)
    points = [
        _MakePoint(scenario, start + velocity * (begin + end) / 2, velocity)
        for begin, end in pairwise(times)
    ]
    if surface is not None and end_time == (surface - start[0]) / velocity[0]:
        position = start + velocity * end_time
        stiffness = max(layer.stiffness for layer in scenario.environment.layers)
        config = scenario.robot
        inverse_inertia = TaskInertiaInverse(
            model=config.model,
            start=position,
            elbow=config.elbow,
            mass=config.mass,
        )[0, 0]
        position[0] += velocity[0] / math.sqrt(stiffness * inverse_inertia)
        points.append(_MakePoint(scenario, position, 0 * velocity))
    return points


def OperatingPointAt(scenario: Scenario, x: float) -> OperatingPoint:
    """Returns the operating point on the tool's path at a position along x.

    The tool moves there with the commanded velocity; behind the contact surface it is
    at rest.

    Args:
        scenario: A valid one.
        x: In m.

    Raises:
        ValueError: If the path does not lead there or the robot does not reach it.
    """
    start = np.asarray(scenario.robot.start, dtype=float)
    velocity = np.asarray(scenario.surgeon.velocity, dtype=float)
    if not math.isfinite(x) or (x != start[0] and not (x - start[0]) * velocity[0] > 0):
        raise ValueError(
            f"position = {x:g}: must be on the tool's path, which starts at x = "
            f"{start[0]:g} m with {velocity[0]:g} m/s"
        )
    position = start.copy()
    if x != start[0]:
        position = start + velocity * (x - start[0]) / velocity[0]
    config = scenario.robot
    try:
        CheckRobot(
            model=config.model,
            start=position,
            elbow=config.elbow,
            mass=config.mass,
            damping=config.damping,
        )
    except ValueError as e:
        raise ValueError(
            f"position = {x:g}: {str(e).removeprefix('robot.start: ')}"
        ) from None
    surface = scenario.contact_surface
    is_inside = surface is not None and x > surface
    return _MakePoint(scenario, position, 0 * velocity if is_inside else velocity)


def OperatingPointOfRun(recording: Recording, time: float) -> OperatingPoint:
    """Returns the operating point at an instant of a run, in whatever motion it is.

    With what the forward channel delivers then, and what an adaptive law has learned.

    Args:
        recording: A run of a teleoperation.
        time: In s; not the instant of a jump.

    Raises:
        ValueError: If the time is not within the run.
    """
    if not recording.time[0] <= time <= recording.time[-1]:
        raise ValueError(
            f"time = {time:g}: must be {recording.time[0]:g} to "
            f"{recording.time[-1]:g} s, the run's"
        )

    def At(*names: str) -> Array:
        return np.concatenate(
            [recording.Interpolate(name, np.array([time]))[0] for name in names]
        )

    estimates = ("control_force", "weights_1", "psi", "weights_3")
    is_adaptive = all(name in recording.signals for name in estimates)
    point = _MakePoint(recording.scenario, At("tool_position"), At("tool_velocity"))
    return replace(
        point,
        forward_packet=At("forward_packet_received"),
        estimates=At(*estimates) if is_adaptive else None,
    )


def LinearizeLoop(
    scenario: Scenario,
    point: OperatingPoint,
    *,
    teleoperator: Diagram | None = None,
) -> LoopModel:
    """Linearises both ends of the loop at an operating point.

    The surgeon is in velocity mode. Unless the point has a forward packet, the forces
    in it, and the states of the controller that are not frozen, are chosen such that
    the tool keeps its velocity: what the surgeon's device would have settled to.

    Args:
        scenario: A valid one.
        point: The operating point.
        teleoperator: The Diagram, made by MakeTeleoperator for this scenario, with
            systems of your own perhaps; None makes the scenario's.

    Raises:
        ValueError: If the robot's state is not as large as position and velocity of
            its tool, a system at either end has a state that is not continuous (a
            filter of samples, a delay of its own), the point is at a border of a layer,
            or the robot cannot be there.
    """
    diagram = MakeTeleoperator(scenario) if teleoperator is None else teleoperator
    return _Linearizer(scenario, point, diagram).Linearize()


def _MakePoint(scenario: Scenario, position: Array, velocity: Array) -> OperatingPoint:
    layers = scenario.environment.layers
    index = layer_index([layer.start for layer in layers], position[0])
    name = layers[index].name if index >= 0 else EMPTY
    return OperatingPoint(name=name, layer=name, position=position, velocity=velocity)


def _ReachableTime(
    scenario: Scenario, start: Array, velocity: Array, end_time: float
) -> float:
    """Returns until when, in s, the robot can follow the path."""

    def IsReachable(time: float) -> bool:
        try:
            CheckRobot(
                model=scenario.robot.model,
                start=start + velocity * time,
                elbow=scenario.robot.elbow,
                mass=scenario.robot.mass,
                damping=scenario.robot.damping,
            )
        except ValueError:
            return False
        return True

    if IsReachable(end_time):
        return end_time
    low, high = 0.0, end_time
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if IsReachable(middle) else (low, middle)
    return low


@dataclass(frozen=True, kw_only=True, eq=False)
class _States:
    """Continuous states of a system which the model has as its own."""

    system: System
    context: Context
    indices: Array

    def Get(self) -> Array:
        return self.context.get_continuous_state_vector().CopyToVector()[self.indices]

    def Set(self, values: Array) -> None:
        x = self.context.get_continuous_state_vector().CopyToVector()
        x[self.indices] = values
        self.context.SetContinuousState(x)

    def GetRates(self) -> Array:
        rates = self.system.EvalTimeDerivatives(self.context).CopyToVector()
        return rates[self.indices]


class _Linearizer:
    """Holds the diagram with its channels cut."""

    def __init__(self, scenario: Scenario, point: OperatingPoint, diagram: Diagram):
        self._scenario = scenario
        self._point = point
        self._root = diagram.CreateDefaultContext()
        self._systems = {x.get_name(): x for x in diagram.GetSystems()}
        self._contexts = {
            name: system.GetMyMutableContextFromRoot(self._root)
            for name, system in self._systems.items()
        }
        self.frozen_weights = False
        self._plant = self._FindStates("robot")
        self._controller = self._FindStates("controller") + self._FindStates(
            "environment"
        )
        self._master = self._FindStates("master")
        n = scenario.num_axes
        self._n = n
        num_states = sum(len(states.indices) for states in self._plant)
        if len(self._plant) != 1 or num_states != 2 * n:
            raise ValueError(
                f"robot: {num_states} states; allowed: {2 * n}, as many as position "
                "and velocity of its tool have"
            )
        self._packet = np.zeros(self._Port("controller", "forward_packet").size())

    def Linearize(self) -> LoopModel:
        self._PlaceTool()
        self._SetForwardPacket(self._packet)
        self._SetReturnPacket(self._Eval("controller", "return_packet"))
        self._packet = self._Eval("master", "forward_packet")
        self._SetForwardPacket(self._packet)
        master, master_error = self._LinearizeMaster()
        if self._point.forward_packet is None:
            # What the master sends whatever it feels, a velocity command say, stays.
            is_free = np.any(master.C != 0, axis=1) | np.any(master.D != 0, axis=1)
            residual = self._Trim(np.flatnonzero(is_free))
        else:
            self._SetForwardPacket(self._point.forward_packet)
            residual = float(np.abs(self._Rates()[self._n :]).max())
        slave, slave_error = self._LinearizeSlave()
        return LoopModel(
            point=self._point,
            master=master,
            slave=slave,
            frozen_weights=self.frozen_weights,
            error=max(master_error, slave_error),
            trim_residual=residual,
        )

    # The diagram.

    def _Port(self, system: str, port: str) -> InputPort:
        return self._systems[system].GetInputPort(port)

    def _Eval(self, system: str, port: str) -> Array:
        return self._systems[system].GetOutputPort(port).Eval(self._contexts[system])

    def _SetForwardPacket(self, packet: Array) -> None:
        # A fixed value takes the place of what the channel delivers.
        port = self._Port("controller", "forward_packet")
        port.FixValue(self._contexts["controller"], packet)
        self._packet = packet

    def _SetReturnPacket(self, packet: Array) -> None:
        port = self._Port("master", "return_packet")
        port.FixValue(self._contexts["master"], packet)

    def _FindStates(self, name: str) -> list[_States]:
        result = []
        for system in _Leaves(self._systems[name]):
            context = system.GetMyMutableContextFromRoot(self._root)
            size = context.num_continuous_states()
            # The environment's is the layer it is in.
            is_sampled = context.num_discrete_state_groups() > 0
            is_sampled |= context.num_abstract_states() > 0
            if is_sampled and name != "environment" and type(system) is not Surgeon:
                raise ValueError(
                    f"{name}: {system.get_name()!r} has a state that is not "
                    "continuous; allowed: continuous states only, for a linear model"
                )
            if isinstance(system, AdaptiveBackstepping):
                # [F_c, W1, Psi, W3]: F_c stays.
                size = system.GetOutputPort("control_force").size()
                self.frozen_weights = True
                if self._point.estimates is not None:
                    context.SetContinuousState(self._point.estimates)
            if size:
                result.append(
                    _States(system=system, context=context, indices=np.arange(size))
                )
        return result

    def _Layer(self) -> float:
        return float(self._Eval("environment", "layer")[0])

    def _PlaceTool(self) -> None:
        """Sets the joints to the operating point."""
        (plant,) = self._plant
        config, point = self._scenario.robot, self._point
        q = InverseKinematics(config.model, point.position, config.elbow)
        n = self._n
        columns = []
        for rates in np.eye(n):
            plant.Set(np.concatenate([q, rates]))
            columns.append(self._Eval("robot", "tool_velocity"))
        self._jacobian = np.array(columns).T
        plant.Set(np.concatenate([q, np.linalg.solve(self._jacobian, point.velocity)]))

    # Vectors of the slave side: x = [joints, controller], u = forward packet.

    def _GetState(self) -> Array:
        return _Concatenate([s.Get() for s in self._plant + self._controller])

    def _SetState(self, x: Array) -> None:
        begin = 0
        for states in self._plant + self._controller:
            states.Set(x[begin : begin + len(states.indices)])
            begin += len(states.indices)

    def _Coordinates(self) -> Array:
        """Returns [r, v, controller]."""
        return _Concatenate(
            [
                self._Eval("robot", "tool_position"),
                self._Eval("robot", "tool_velocity"),
                *(states.Get() for states in self._controller),
            ]
        )

    def _Rates(self) -> Array:
        """Returns the time rates of the coordinates."""
        return _Concatenate(
            [
                self._Eval("robot", "tool_velocity"),
                self._Eval("robot", "tool_acceleration"),
                *(states.GetRates() for states in self._controller),
            ]
        )

    def _Steps(self) -> Array:
        """Returns the longest steps of x."""
        gap = self._BorderDistance()
        speed = float(np.linalg.norm(self._scenario.surgeon.velocity))
        per_joint = np.linalg.norm(self._jacobian, axis=0)
        state = self._GetState()[2 * self._n :]
        return np.concatenate(
            [
                _STEP_SHARE * gap / per_joint,
                speed / per_joint,
                _STEP * np.maximum(1.0, np.abs(state)),
            ]
        )

    def _BorderDistance(self) -> float:
        """Returns how far it is to the nearest border, at most the task's path."""
        x = self._point.position[0]
        starts = [layer.start for layer in self._scenario.environment.layers]
        distance = min((abs(x - start) for start in starts), default=math.inf)
        if distance == 0:
            raise ValueError(
                f"position = {x:g}: must not be the border of a layer, where the "
                "environment has no linear model"
            )
        path = self._scenario.duration * float(
            np.linalg.norm(self._scenario.surgeon.velocity)
        )
        return min(distance, path, 1.0)

    def _Trim(self, free: NDArray[np.int_]) -> float:
        """Chooses free entries of the packet and the controller's state.

        Returns:
            The largest rate that remains.
        """
        n, m = self._n, len(free)

        def Residual(unknown: Array) -> Array:
            packet = self._packet.copy()
            packet[free] = unknown[:m]
            self._SetForwardPacket(packet)
            state = self._GetState()
            state[2 * n :] = unknown[m:]
            self._SetState(state)
            return self._Rates()[n:]

        unknown = np.concatenate([self._packet[free], self._GetState()[2 * n :]])
        steps = _STEP * np.maximum(1.0, np.abs(unknown))
        for _ in range(10):
            residual = Residual(unknown)
            if not len(unknown):
                break
            slope, _ = _Differentiate(Residual, unknown, steps)
            change = np.linalg.lstsq(slope, -residual, rcond=1e-10)[0]
            unknown = unknown + change
            if np.abs(change).max() <= 1e-12 * max(1.0, float(np.abs(unknown).max())):
                break
        return float(np.abs(Residual(unknown)).max())

    def _LinearizeSlave(self) -> tuple[StateSpace, float]:
        layer = self._Layer()
        x0, u0 = self._GetState(), self._packet.copy()

        def Evaluate() -> Array:
            if self._Layer() != layer:
                raise RuntimeError("a difference crosses the border of a layer")
            return np.concatenate(
                [
                    self._Coordinates(),
                    self._Rates(),
                    self._Eval("controller", "return_packet"),
                ]
            )

        def OfState(x: Array) -> Array:
            self._SetState(x)
            return Evaluate()

        def OfPacket(u: Array) -> Array:
            self._SetForwardPacket(u)
            return Evaluate()

        by_x, error_x = _Differentiate(OfState, x0, self._Steps())
        self._SetState(x0)
        by_u, error_u = _Differentiate(OfPacket, u0, np.full(len(u0), _STEP))
        self._SetForwardPacket(u0)
        size = len(x0)
        # The coordinates are a function of the state: d/d(coordinates).
        to_coordinates = np.linalg.inv(by_x[:size])
        by_z, error_z = (
            by_x[size:] @ to_coordinates,
            error_x[size:] @ np.abs(to_coordinates),
        )
        by_u, error_u = by_u[size:], error_u[size:]
        model = StateSpace(A=by_z[:size], B=by_u[:size], C=by_z[size:], D=by_u[size:])
        return model, _RelativeError(
            [(by_z[:size], error_z[:size]), (by_u[:size], error_u[:size])]
        )

    def _LinearizeMaster(self) -> tuple[StateSpace, float]:
        port = self._Port("master", "return_packet")
        u0 = port.Eval(self._contexts["master"])
        x0 = _Concatenate([states.Get() for states in self._master])

        def Evaluate() -> Array:
            return _Concatenate(
                [
                    *(states.GetRates() for states in self._master),
                    self._Eval("master", "forward_packet"),
                ]
            )

        def OfState(x: Array) -> Array:
            begin = 0
            for states in self._master:
                states.Set(x[begin : begin + len(states.indices)])
                begin += len(states.indices)
            return Evaluate()

        def OfPacket(u: Array) -> Array:
            self._SetReturnPacket(u)
            return Evaluate()

        by_x, error_x = _Differentiate(OfState, x0, _STEP * np.maximum(1.0, np.abs(x0)))
        if len(x0):
            OfState(x0)
        by_u, error_u = _Differentiate(OfPacket, u0, np.full(len(u0), _STEP))
        self._SetReturnPacket(u0)
        size = len(x0)
        model = StateSpace(A=by_x[:size], B=by_u[:size], C=by_x[size:], D=by_u[size:])
        return model, _RelativeError([(by_x, error_x), (by_u, error_u)])


def _Leaves(system: System) -> Iterator[System]:
    """Yields the systems whose states are told apart."""
    if isinstance(system, Diagram) and not isinstance(system, AdaptiveBackstepping):
        for child in system.GetSystems():
            yield from _Leaves(child)
    else:
        yield system


def _Concatenate(parts: Sequence[Array]) -> Array:
    return np.concatenate([np.zeros(0), *parts])


def _Differentiate(
    function: Callable[[Array], Array], x0: Array, steps: Array
) -> tuple[Array, Array]:
    """Returns the Jacobian (k, n) of a function and its estimated error (k, n)."""
    size = len(function(x0)) if len(x0) == 0 else 0
    columns, errors = [], []
    for j, longest in enumerate(steps):
        table: list[Array] = []
        for i in range(_NUM_STEPS):
            step = longest / 2**i
            x = x0.copy()
            x[j] = x0[j] + step
            high, high_value = x[j], function(x)
            x[j] = x0[j] - step
            row = [(high_value - function(x)) / (high - x[j])]
            # Each extrapolation removes the next even power of the step.
            for k in range(i):
                row.append(row[k] + (row[k] - table[k]) / (4 ** (k + 1) - 1))
            previous, table = table, row
        columns.append(table[-1])
        errors.append(np.abs(table[-1] - previous[-1]))
    if not columns:
        return np.zeros((size, 0)), np.zeros((size, 0))
    return np.array(columns).T, np.array(errors).T


def _RelativeError(parts: Sequence[tuple[Array, Array]]) -> float:
    """Returns the largest error relative to the largest entry of its matrix."""
    return max(
        float(error.max() / max(np.abs(matrix).max(), 1e-300))
        for matrix, error in parts
        if matrix.size
    )
