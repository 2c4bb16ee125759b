"""One half of the loop, simulated with the packets that the other half sends."""

from collections.abc import Callable
from enum import IntEnum
from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder

from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.signals import SystemsByPath
from teleop_drake.loops.framework.validation import Refuse
from teleop_drake.loops.run.compiled_run import StartFed
from teleop_drake.model.blocks.robots.facts import FactsOfRobot
from teleop_drake.model.laws.task_space import displacement
from teleop_drake.model.scenario import Scenario
from teleop_drake.model.signals import NamedSignals
from teleop_drake.model.teleoperator import AddTeleoperator

Driver = Callable[[float, Array], Any]
"""A function of the time in s and the packet that is fed; returns the one to send."""

# First letters of the parts that are held while trust falls: positions, energies.
_HELD_PARTS = ("p", "x", "E")

# The largest natural frequency of the spring that holds the tool, rad/s.
_HOLD_RATE = 20.0


WAYS = {"operator": ("return", "forward"), "robot": ("forward", "return")}
"""The directions in which each side receives and sends packets."""


class Turn(IntEnum):
    """The change of trust in a period; in a missed period nothing is fed."""

    COMES_BACK = -1
    MISSED = 0
    FALLS = 1


class Half:
    """A simulated side, fed with the received packets as far as they are trusted.

    Trust is a number from 0 to 1. While it falls, the forces, velocities, accelerations
    and waves that are fed fall to zero, and positions and energies are held. While it
    comes back, all of them approach the received packet. As long as trust is below 1, a
    spring and a damper hold the robot's tool in its place, with the share 1 - trust.
    They are critically damped for the tool's inertia at the start.

    Args:
        scenario: The scenario of the whole loop.
        side: One of WAYS.
        period: The time between steps, s.
        fade: The time in which trust falls from 1 to 0, and comes back, s.
        step: A driver that replaces the simulation.

    Attributes:
        heard: The direction of the packets that the side receives.
        spoken: The direction of the packets that it sends.
        fed: The packet that is fed: the received one, changed as trust requires. At the
            start, the architecture's initial packet.
        sent: The packets that were sent, after the architecture's initial packet.
        trust: The present trust, 0 to 1.
        model: The scenario, the side's diagram and the config of the solver.
        run: The compiled run; None where there is a driver.

    Raises:
        CannotCompile: If a system cannot be compiled; it is named.
    """

    def __init__(
        self,
        scenario: Scenario,
        side: str,
        period: float,
        fade: float,
        *,
        step: Driver | None = None,
    ):
        self.scenario = scenario
        self.side = side
        self.period = period
        self.fade = fade
        self.heard, self.spoken = WAYS[side]
        builder = DiagramBuilder()
        architecture = AddTeleoperator(builder, scenario, side=side)
        initial = {
            "forward": np.array(architecture.initial_forward_packet, float),
            "return": np.array(architecture.initial_return_packet, float),
        }
        self.fed = initial[self.heard]
        self.sent = [initial[self.spoken]]
        self.trust = 1.0
        # Number of periods by which trust has fallen, and of a fall from 1 to 0.
        self._faded = 0
        self._num_fades = int(np.ceil(fade / period))
        self._falls = self._PartsThatFall()
        # The packets that were fed before each step, and the signals at the step.
        self._fed_before: list[Array] = []
        self._signals: list[Array] = []
        # Initial values of the inputs of the diagram.
        inputs = {"packet": self.fed}
        channel = builder.GetSubsystemByName(f"{self.heard}_channel")
        builder.ExportInput(channel.get_input_port(), "packet")
        if side == "robot":
            inputs["force"] = self._AddHold(builder)
        diagram = builder.Build()
        self.systems = SystemsByPath(diagram)
        # With a driver, the packet to send is the only signal, and no input is fed.
        self.run: CompiledRun | None = None
        self._places = {f"{self.spoken}_packet_sent": slice(None)}
        self._inputs: dict[str, slice] = {}
        if step is None:
            self.run, self._places, self._inputs = StartFed(
                diagram,
                scenario.simulator,
                NamedSignals(diagram.GetSystems()),
                scenario.duration,
                **inputs,
            )
            self._sample: Callable[[float], Any] = self.run.Sample
        else:
            drive = step
            self._sample = lambda t: drive(t, self.fed)

    def _PartsThatFall(self) -> Array:
        """Returns a mask of the packet's numbers that fall with trust."""
        controller = self.scenario.controller
        parts = getattr(controller.Chosen(), f"{self.heard}_parts")
        names = np.repeat(parts, self.scenario.num_axes)[: self.fed.size]
        if len(names) < self.fed.size:
            allowed = f"one that has {self.heard}_parts, so that its forces can fall"
            Refuse("controller.kind", controller.kind, allowed)
        return np.array([not name.startswith(_HELD_PARTS) for name in names])

    def _AddHold(self, builder: DiagramBuilder) -> Array:
        """Adds the exported input `force`, which holds the tool, to the law's force.

        Returns:
            The initial value of the input.
        """
        robot = builder.GetSubsystemByName("robot")
        inertia = FactsOfRobot(robot).inertia
        if inertia is None:
            Refuse("robot", robot.get_name(), "one that reports its inertia")
        num_axes = len(inertia)
        rate = min(_HOLD_RATE, 0.2 / self.period)
        self._stiffness = rate**2 * inertia
        self._lead = 2 / rate
        # The sum of both forces is put between the law and the robot.
        law = builder.GetSubsystemByName("controller").GetOutputPort("control_force")
        target = robot.GetInputPort("control_force")
        hold = builder.AddNamedSystem("hold", Adder(2, num_axes))
        builder.Disconnect(law, target)
        builder.Connect(law, hold.get_input_port(0))
        builder.Connect(hold.get_output_port(), target)
        builder.ExportInput(hold.get_input_port(1), "force")
        return np.zeros(num_axes)

    def Step(self, t: float, heard: Array, turn: Turn) -> None:
        """Advances to t in s, and appends the packet to `sent`; then feeds the inputs.

        Args:
            t: The time of the step, s.
            heard: The received packet that is in use.
            turn: The change of trust.

        Raises:
            ArithmeticError: If the packet has another size than the initial one, or
                numbers that are not finite; or if the run cannot continue.
        """
        before = self.fed
        if turn != Turn.MISSED:
            self._Fade(heard, turn)
        signals = np.array(self._sample(t))
        sent = signals[self._places[f"{self.spoken}_packet_sent"]]
        if sent.shape != self.sent[0].shape or not np.isfinite(sent).all():
            wanted = f"must send {self.sent[0].size} finite numbers"
            raise ArithmeticError(f"{wanted}, not {sent}")
        self.sent.append(sent)
        self._fed_before.append(before)
        self._signals.append(signals)
        if turn == Turn.MISSED or self.run is None:
            return
        self.run.Feed(self._inputs[f"{self.heard}_channel"], self.fed)
        if self.side == "robot":
            self.run.Feed(self._inputs["hold"], self._HoldingForce(signals))

    def _Fade(self, heard: Array, turn: Turn) -> None:
        """Changes trust by one period, and moves `fed` towards a target.

        The target is the received packet or, while trust falls, a safe packet.
        """
        self._faded = min(max(self._faded + turn, 0), self._num_fades)
        self.trust = 1 - self._faded / self._num_fades
        if turn == Turn.FALLS:
            target = np.where(self._falls, 0.0, self.fed)
            num_left = self._num_fades - self._faded
        else:
            target = heard
            num_left = self._faded
        # In equal steps, of which the last one reaches the target.
        if num_left == 0:
            self.fed = target
        else:
            self.fed = self.fed + (target - self.fed) / (num_left + 1)

    def _HoldingForce(self, signals: Array) -> Array:
        """Returns the force of the spring and the damper; 0 as long as trust is 1."""
        # The place to hold is the last one with full trust, or that of the first step.
        p = signals[self._places["tool_position"]]
        v = signals[self._places["tool_velocity"]]
        if self.trust == 1 or len(self._signals) == 1:
            self._place = p
        apart = displacement(self._place, p) if self.trust < 1 else 0 * p
        return (1 - self.trust) * self._stiffness @ (apart - self._lead * v)

    def Signals(self, num: int) -> dict[str, Array]:
        """Returns the signals (N, k) of the first `num` steps, by their names."""
        signals = np.array(self._signals[:num])
        received = {f"{self.heard}_packet_received": np.array(self._fed_before[:num])}
        return received | {name: signals[:, at] for name, at in self._places.items()}
