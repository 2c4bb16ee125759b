"""The teleoperator cut at its channels: it settles, and both sides are linearised."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram

from teleop_drake.analysis.cut_diagram import (
    STEP,
    Concatenate,
    CutOpen,
    CutPart,
    FindHeldForce,
    FixedInput,
    SetStates,
    States,
)
from teleop_drake.analysis.linear_models import LoopModel, TwoPortModel
from teleop_drake.analysis.operating_point import OperatingPoint
from teleop_drake.analysis.side_of_loop import LinearSide, SideOfLoop
from teleop_drake.analysis.tool_motion import ToolMotion
from teleop_drake.contexts import ContextsIn
from teleop_drake.environments import SurfacesOf
from teleop_drake.kernel.linear_part import FROZEN_WEIGHTS, IDLE_PASSIVITY, LinearPartOf
from teleop_drake.numerics.differences import differentiate
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.scenario import Scenario
from teleop_drake.validation import Refuse

Array = NDArray[np.float64]

# The longest step of a difference, as a share of the way to the nearest surface.
_STEP_SHARE = 1 / 50

# The least path in m and speed in m/s that lengths of steps derive from: shorter steps
# would drown in rounding.
_LEAST_SCALE = 1e-3

# What is closer than this to a surface, in m, is on it.
_LEAST_DISTANCE = 1e-9


class Linearizer:
    """Holds the diagram with its channels cut.

    Args:
        scenario: A valid one.
        point: The operating point.
        diagram: The teleoperator.

    Raises:
        ScenarioError: If a block has no linear model.
    """

    def __init__(self, scenario: Scenario, point: OperatingPoint, diagram: Diagram):
        self._scenario = scenario
        self._point = point
        self._contexts = ContextsIn(diagram, diagram.CreateDefaultContext())
        self._systems = {x.get_name(): x for x in diagram.GetSystems()}
        self._surfaces = SurfacesOf(self._systems["environment"]) or ()
        if point.holds_force:
            self._HoldForce()
        self._master, self._controller, self._environment, robot = (
            CutOpen(
                self._systems[name],
                self._contexts,
                estimates=point.estimates,
                may_delay=name in ("master", "controller"),
            )
            for name in ("master", "controller", "environment", "robot")
        )
        self._robot_speed_scales = robot.speed_scales
        self._forward_packet = self._Fix(("controller", "forward_packet"))
        self._return_packet = self._Fix(("master", "return_packet"))
        n = self._n = scenario.num_axes
        self._motion = ToolMotion(
            config=scenario.robot,
            robot=self._systems["robot"],
            states=robot.states,
            num_axes=n,
            evaluate=lambda name: self._Eval("robot", name),
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
            frozen_weights=FROZEN_WEIGHTS in self._controller.assumptions,
            idle_passivity=self._is_passivity_idle,
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
            self._controller.states,
        )
        surgeon, device = (
            self._systems["master"].GetSubsystemByName(name)
            for name in ("surgeon", "haptic_device")
        )
        if not LinearPartOf(surgeon).has_modes or surgeon.num_continuous_states():
            allowed = "an operator without dynamics: the two-port ends at the hand"
            Refuse("surgeon", type(surgeon).__name__, allowed)
        contexts = [self._contexts[x] for x in (surgeon, device)]
        hand = FixedInput(
            ports=[surgeon.GetInputPort("haptic_force")], contexts=contexts[:1]
        )
        hand.Set(hand.Get())
        felt = device.GetInputPort("felt_velocity")
        master, master_error = self._LinearizeMaster(
            [hand],
            [lambda: felt.Eval(contexts[1])],
            [
                states
                for states in self._master.states
                if states.context is not contexts[1]
            ],
        )
        return TwoPortModel(
            point=self._point,
            master=master,
            slave=slave,
            idle_passivity=self._is_passivity_idle,
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
        delays = self._master.delays + self._controller.delays
        return tuple(x.delay for x in delays for _ in range(x.size))

    @property
    def _is_passivity_idle(self) -> bool:
        return IDLE_PASSIVITY in self._master.assumptions | self._controller.assumptions

    # The operating point.

    def _HoldForce(self) -> None:
        """Lets the operator have perceived contact."""
        found = FindHeldForce(self._systems["master"])
        if found is None:
            allowed = "an operator that tells which force it holds after contact"
            Refuse("surgeon", self._scenario.surgeon.kind, allowed)
        block, held = found
        self._contexts[block].SetDiscreteState(held.state)

    def _SettleAndLinearize(self) -> tuple[LinearSide, LinearSide, float]:
        """Returns master and slave, each with its error, and the rates that remain."""
        self._motion.Place(self._point.position, self._point.velocity)
        self._forward_packet.Set(np.zeros(self._forward_packet.ports[0].size()))
        self._SettleDelays(self._controller)
        self._return_packet.Set(self._Eval("controller", "return_packet"))
        self._SettleDelays(self._master)
        self._forward_packet.Set(self._Eval("master", "forward_packet"))
        master, master_error = self._LinearizeMaster([], [], self._master.states)
        if self._point.forward_packet is None:
            # What the master sends whatever it feels, a velocity command say, stays.
            size = self._PacketSizes()[0]
            depends = np.hstack([master.C, master.D])[:size]
            residual = self._Trim(np.flatnonzero(np.any(depends != 0, axis=1)))
        else:
            self._forward_packet.Set(self._point.forward_packet)
            residual = float(np.abs(self._Rates()).max())
        slave, slave_error = self._LinearizeSlave([], [], self._OtherStates())
        return (master, master_error), (slave, slave_error), residual

    def _SettleDelays(self, part: CutPart) -> None:
        """Lets the delays inside deliver what goes into them now."""
        for delay in part.delays:
            delay.Set(delay.GetInput())

    def _OtherStates(self) -> list[States]:
        """Returns the slave's states without the robot's."""
        return self._controller.states + self._environment.states

    def _Rates(self) -> Array:
        """Returns the time rates of [v, the other states of the slave]."""
        return Concatenate(
            [
                self._Eval("robot", "tool_acceleration"),
                *(states.GetRates() for states in self._OtherStates()),
            ]
        )

    def _Trim(self, free: NDArray[np.int_]) -> float:
        """Chooses free entries of the packet and the controller's state.

        Returns:
            The largest rate that remains.
        """
        m = len(free)
        packet, others = self._forward_packet, self._OtherStates()
        packet_0 = packet.Get()

        def Residual(unknown: Array) -> Array:
            values = packet_0.copy()
            values[free] = unknown[:m]
            packet.Set(values)
            SetStates(others, unknown[m:])
            self._SettleDelays(self._controller)
            return self._Rates()

        unknown = Concatenate([packet_0[free], *(x.Get() for x in others)])
        packet_steps = STEP * np.maximum(1.0, np.abs(unknown[:m]))
        steps = Concatenate([packet_steps, *(x.Steps() for x in others)])
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
    ) -> LinearSide:
        passed = self._PassedSurfaces()

        def ReturnPacket() -> Array:
            if self._PassedSurfaces() != passed:
                raise RuntimeError("a difference crosses a surface")
            return self._Eval("controller", "return_packet")

        side = SideOfLoop(
            "controller",
            inputs=[*inputs, self._forward_packet],
            outputs=[*outputs, ReturnPacket],
            states=states,
            delays=self._controller.delays,
            motion=self._motion,
            input_scale=min(self._controller.input_scales),
        )
        speed = float(np.linalg.norm(self._scenario.surgeon.velocity))
        path = _STEP_SHARE * self.SurfaceDistance()
        scales = self._environment.speed_scales + self._controller.speed_scales
        scales += self._robot_speed_scales
        speed = min(max(speed, _LEAST_SCALE), *scales)
        steps = self._motion.Steps(path, speed)
        return side.Linearize(self._point.name, steps)

    def _LinearizeMaster(
        self,
        inputs: Sequence[FixedInput],
        outputs: Sequence[Callable[[], Array]],
        states: Sequence[States],
    ) -> LinearSide:
        side = SideOfLoop(
            "master",
            inputs=[*inputs, self._return_packet],
            outputs=[*outputs, lambda: self._Eval("master", "forward_packet")],
            states=states,
            delays=self._master.delays,
        )
        return side.Linearize(self._point.name)

    def _PassedSurfaces(self) -> list[bool]:
        p_WT = self._Eval("robot", "tool_position")
        return [bool(surface.Depth(p_WT) >= 0) for surface in self._surfaces]

    def SurfaceDistance(self) -> float:
        """Returns how far it is to the nearest surface, at most the task's path, in m.

        A path of less than a millimetre says nothing of how the robot bends.

        Raises:
            ScenarioError: If the point is on a surface.
        """
        p_WT = self._point.position
        distance = min(
            (abs(float(surface.Depth(p_WT))) for surface in self._surfaces),
            default=math.inf,
        )
        if distance < _LEAST_DISTANCE:
            allowed = "off every surface of the environment, for a linear model"
            Refuse("position", p_WT, allowed)
        path = self._scenario.duration * float(
            np.linalg.norm(self._scenario.surgeon.velocity)
        )
        return min(distance, max(path, _LEAST_SCALE), 1.0)


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
