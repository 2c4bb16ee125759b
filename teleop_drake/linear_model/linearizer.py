"""The teleoperator cut at its channels: it settles, and both sides are linearised."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, InputPort, OutputPort

from teleop_drake.contexts import ContextsIn
from teleop_drake.environments import SurfacesOf
from teleop_drake.kernel.linear_part import (
    FROZEN_WEIGHTS,
    IDLE_PASSIVITY,
    LinearPartOf,
)
from teleop_drake.linear_model.autodiff_diagram import DualDiagram
from teleop_drake.linear_model.cuts import (
    CutOpen,
    FindHeldForce,
    FixedInput,
    InnerDelay,
    SetStates,
    States,
)
from teleop_drake.linear_model.models import LoopModel, TwoPortModel
from teleop_drake.linear_model.operating_point import OperatingPoint
from teleop_drake.linear_model.tool_motion import ToolMotion
from teleop_drake.numerics.state_space import StateSpace
from teleop_drake.scenario import Scenario
from teleop_drake.validation import Refuse, ScenarioError

Array = NDArray[np.float64]

_PARTS = ("master", "controller", "environment", "robot")

# Longest difference of a block that does not convert: as a share of values of 1 and
# more, and of the way to the nearest surface.
_STEP = 1e-4
_STEP_SHARE = 1 / 50

# What is closer than this to a surface, in m, is on it.
_LEAST_DISTANCE = 1e-9


class Linearizer:
    """Holds the diagram with its channels cut.

    Args:
        scenario: A valid one.
        point: The operating point.
        diagram: The teleoperator.
        dual: What another Linearizer of this diagram has cut open; None: nothing yet.

    Attributes:
        dual: The diagram, cut open.

    Raises:
        ScenarioError: If a block has no linear model.
    """

    def __init__(
        self,
        scenario: Scenario,
        point: OperatingPoint,
        diagram: Diagram,
        dual: DualDiagram | None = None,
    ):
        self.dual = dual
        self._scenario = scenario
        self._point = point
        self._diagram = diagram
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
            for name in _PARTS
        )
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
        dual = self._Settle()
        return LoopModel(
            point=self._point,
            master=self._LinearizeMaster(dual, [], [], self._master.states),
            slave=self._LinearizeSlave(dual, [], [], self._OtherStates()),
            frozen_weights=FROZEN_WEIGHTS in self._controller.assumptions,
            idle_passivity=self._is_passivity_idle,
            packet_sizes=self._PacketSizes(),
            inner_delays=self._InnerDelays(),
            motion=None,
            by_differences=tuple(dual.by_differences),
            trim_residual=self._residual,
        )

    def LinearizeTwoPort(self) -> TwoPortModel:
        """Returns the model between the hand and the environment."""
        # It settles with the environment and the haptic device.
        self._Settle()
        force = self._Fix(
            ("robot", "environment_force"), ("controller", "environment_force")
        )
        force.Set(self._Eval("environment", "environment_force"))
        operator, device = (
            self._systems["master"].GetSubsystemByName(name)
            for name in ("surgeon", "haptic_device")
        )
        if not LinearPartOf(operator).has_modes or operator.num_continuous_states():
            allowed = "an operator without dynamics: the two-port ends at the hand"
            Refuse("surgeon", type(operator).__name__, allowed)
        hand = FixedInput(
            ports=[operator.GetInputPort("haptic_force")],
            contexts=[self._contexts[operator]],
        )
        hand.Set(hand.Get())
        dual = self._Open(force, hand)
        tool_velocity = self._Output("robot", "tool_velocity")
        felt_velocity = device.GetInputPort("felt_velocity")
        states = [x for x in self._master.states if x.system is not device]
        return TwoPortModel(
            point=self._point,
            master=self._LinearizeMaster(dual, [hand], [felt_velocity], states),
            slave=self._LinearizeSlave(
                dual, [force], [tool_velocity], self._controller.states
            ),
            idle_passivity=self._is_passivity_idle,
            packet_sizes=self._PacketSizes(),
            inner_delays=self._InnerDelays(),
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

    def _Output(self, system: str, port: str) -> OutputPort:
        return self._systems[system].GetOutputPort(port)

    def _Open(self, *more: FixedInput) -> DualDiagram:
        """Returns the diagram with its channels cut, and with more that is set."""
        fixed = (self._forward_packet, self._return_packet, *more)
        return DualDiagram(
            self._diagram,
            self._contexts,
            cut=[port for x in fixed for port in x.ports],
            delays=[x.system for x in self._master.delays + self._controller.delays],
            parts=_PARTS,
            step=min(_STEP, _STEP_SHARE * self.SurfaceDistance()),
        )

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

    def _Settle(self) -> DualDiagram:
        """Brings the Contexts to the operating point; returns the diagram cut open."""
        self._motion.Place(self._point.position, self._point.velocity)
        self._forward_packet.Set(np.zeros(self._forward_packet.ports[0].size()))
        for delay in self._controller.delays:
            delay.Settle()
        self._return_packet.Set(self._Eval("controller", "return_packet"))
        for delay in self._master.delays:
            delay.Settle()
        self._forward_packet.Set(self._Eval("master", "forward_packet"))
        dual = self.dual = self.dual or self._Open()
        free = np.zeros(0, dtype=int)
        if self._point.forward_packet is None:
            # What the master sends whatever it feels, a velocity command say, stays.
            delays, states = self._master.delays, self._master.states
            inputs: list[FixedInput | InnerDelay] = [self._return_packet, *delays]
            sent = [self._Output("master", "forward_packet")]
            ((_, slope),) = dual.Evaluate(self._contexts, states, inputs, sent)
            free = np.flatnonzero(np.any(slope != 0, axis=1))
            others = self._OtherStates()
        else:
            self._forward_packet.Set(self._point.forward_packet)
            others = []
        self._residual = self._Trim(dual, free, others)
        return dual

    def _OtherStates(self) -> list[States]:
        """Returns the slave's states without the robot's."""
        return self._controller.states + self._environment.states

    def _Trim(
        self, dual: DualDiagram, free: NDArray[np.int_], others: Sequence[States]
    ) -> float:
        """Chooses free entries of the packet and the controller's state.

        Returns:
            The largest rate that remains.
        """
        packet, delays = self._forward_packet, self._controller.delays
        tool = self._Output("robot", "tool_acceleration")
        num_states, num_sent = sum(len(x.indices) for x in others), packet.Get().size
        chosen = np.concatenate([np.arange(num_states), num_states + free])
        seen: list[States | InputPort | OutputPort] = [tool, *self._OtherStates()]
        entering = [x.system.get_input_port() for x in delays]
        for _ in range(10):
            for delay in delays:
                delay.Settle()
            found = dual.Evaluate(
                self._contexts, others, [packet, *delays], [*seen, *entering]
            )
            rates = np.concatenate([value for value, _ in found[: len(seen)]])
            if not len(chosen):
                break
            slope = np.vstack([by for _, by in found[: len(seen)]])
            if delays:
                # The delays deliver what goes into them: d = Z x + D d.
                first = num_states + num_sent
                inner = np.vstack([by for _, by in found[len(seen) :]])
                loop = np.eye(len(inner)) - inner[:, first:]
                by_rest = np.linalg.solve(loop, inner[:, :first])
                slope = slope[:, :first] + slope[:, first:] @ by_rest
            change = np.zeros(num_states + num_sent)
            change[chosen] = np.linalg.lstsq(slope[:, chosen], -rates, rcond=1e-10)[0]
            x = np.concatenate([np.zeros(0), *(x.Get() for x in others), packet.Get()])
            largest = max(1.0, float(np.abs((x + change)[chosen]).max()))
            if np.abs(change).max() <= 1e-12 * largest:
                break
            SetStates(others, (x + change)[:num_states])
            packet.Set((x + change)[num_states:])
        return float(np.abs(rates).max())

    # The models.

    def _LinearizeSlave(
        self,
        dual: DualDiagram,
        inputs: Sequence[FixedInput],
        outputs: Sequence[InputPort | OutputPort],
        states: Sequence[States],
    ) -> StateSpace:
        return self._LinearizeSide(
            dual,
            "controller",
            [*inputs, self._forward_packet],
            [*outputs, self._Output("controller", "return_packet")],
            states,
            self._controller.delays,
            self._motion,
        )

    def _LinearizeMaster(
        self,
        dual: DualDiagram,
        inputs: Sequence[FixedInput],
        outputs: Sequence[InputPort | OutputPort],
        states: Sequence[States],
    ) -> StateSpace:
        return self._LinearizeSide(
            dual,
            "master",
            [*inputs, self._return_packet],
            [*outputs, self._Output("master", "forward_packet")],
            states,
            self._master.delays,
        )

    def _LinearizeSide(
        self,
        dual: DualDiagram,
        name: str,
        inputs: Sequence[FixedInput],
        outputs: Sequence[InputPort | OutputPort],
        states: Sequence[States],
        delays: Sequence[InnerDelay],
        motion: ToolMotion | None = None,
    ) -> StateSpace:
        """Returns the model of one side of the loop at what the Contexts hold.

        Args:
            motion: Of the robot, whose coordinates come before the other states; None:
                there is no robot.
        """
        tool = motion.Seen() if motion else []
        entering = [x.system.get_input_port() for x in delays]
        slopes, bends = dual.Linearize(
            self._contexts,
            [*([motion.states] if motion else []), *states],
            [*inputs, *delays],
            [*tool, *states, *outputs, *entering],
        )
        if any(bends):
            raise ScenarioError(
                f"{name} = a law that bends at the operating point "
                f"{self._point.name!r}, as one that switches there: must have one "
                "linear model"
            )
        n = sum(len(x.indices) for x in states)
        num_tool = len(motion.states.indices) if motion else 0
        size = num_tool + n
        num_all = slopes[-1].shape[1]
        coordinates = np.eye(size, num_all)
        rows = slopes[len(tool) :]
        if motion:
            coordinates[:num_tool], rates = motion.Coordinates(slopes[: len(tool)])
            rows = [rates, *rows]
        by_all = np.vstack(rows)
        # The coordinates are a function of the state: d/d(coordinates).
        by_x = by_all[:, :size] @ np.linalg.inv(coordinates[:, :size])
        by_u = by_all[:, size:]
        return StateSpace(A=by_x[:size], B=by_u[:size], C=by_x[size:], D=by_u[size:])

    def SurfaceDistance(self) -> float:
        """Returns how far it is to the nearest surface, at most 1 m.

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
        return min(distance, 1.0)
