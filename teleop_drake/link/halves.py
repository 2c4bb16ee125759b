"""A side of the teleoperator as a compiled run that goes on period by period."""

from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder

from teleop_drake.compiler.check import CheckVisited
from teleop_drake.integrator.problem import EVALUATIONS, SAME, STEPS
from teleop_drake.link.packets import Array
from teleop_drake.numerics.step_polynomials import straight_steps
from teleop_drake.robots.facts import FactsOfRobot
from teleop_drake.scenario import Scenario
from teleop_drake.simulation.compiled_run import CompileLoop, StartRun
from teleop_drake.simulation.run import Outcome
from teleop_drake.simulation.simulate import MakeRecording
from teleop_drake.teleoperator import AddTeleoperator
from teleop_drake.validation import Refuse

WAYS = {"operator": ("return", "forward"), "robot": ("forward", "return")}
"""The directions in which a side hears and speaks."""

# Parts of a packet that are held where nothing is heard: positions and energies.
_HELD = ("p", "x", "E")

# How fast the tool is held in its place, rad/s at most.
_RATE = 20.0


class Half:
    """A side that is simulated, and fed with what is heard as far as that is trusted.

    As trust falls, so do forces, velocities, accelerations and waves, and positions are
    held; as it comes back, they all go to what is heard. Meanwhile a spring and a
    damper hold the tool of the robot in its place. With its inertia at the start they
    are critically damped.

    Args:
        scenario: Of the whole loop.
        side: One of WAYS.
        period: Between calls, s.
        num: Periods in which trust falls from 1 to 0, and comes back.
        own: Systems of one's own, as MakeTeleoperator() takes them.

    Attributes:
        initial: The first packet of each direction, by its name.
        fed: What it is fed with.
        trust: 0 to 1.

    Raises:
        CannotCompile: If a system cannot be compiled; it is named.
    """

    def __init__(
        self, scenario: Scenario, side: str, period: float, num: int, own: Any
    ):
        heard, spoken = WAYS[side]
        builder = DiagramBuilder()
        architecture = AddTeleoperator(builder, scenario, side=side, **own)
        self.initial = {
            way: np.array(getattr(architecture, f"initial_{way}_packet"), float)
            for way in WAYS[side]
        }
        self.fed = fed = self.initial[heard]
        self.trust, self._num, self._faded = 1.0, num, 0
        parts = getattr(scenario.controller.Chosen(), f"{heard}_parts")
        names = np.repeat(parts, scenario.num_axes)[: fed.size]
        if len(names) < fed.size:
            allowed = f"one that has {heard}_parts, so that its forces can fall"
            Refuse("controller.kind", scenario.controller.kind, allowed)
        self._falls = np.array([not name.startswith(_HELD) for name in names])
        inputs = {"packet": fed}
        channel = builder.GetSubsystemByName(f"{heard}_channel")
        builder.ExportInput(channel.get_input_port(), "packet")
        if side == "robot":
            robot = builder.GetSubsystemByName("robot")
            if (inertia := FactsOfRobot(robot).inertia) is None:
                Refuse("robot", robot.get_name(), "one that tells its inertia")
            rate = min(_RATE, 0.2 / period)
            self._stiffness, self._lead = rate**2 * inertia, 2 / rate
            inputs["force"] = np.zeros(len(inertia))
            hold = builder.AddNamedSystem("hold", Adder(2, len(inertia)))
            target = robot.GetInputPort("control_force")
            controller = builder.GetSubsystemByName("controller")
            law = controller.GetOutputPort("control_force")
            builder.Disconnect(law, target)
            builder.Connect(law, hold.get_input_port(0))
            builder.ExportInput(hold.get_input_port(1), "force")
            builder.Connect(hold.get_output_port(), target)
        diagram, config = builder.Build(), scenario.simulator
        loop, context = CompileLoop(diagram, config, **inputs)
        self._run = StartRun(loop, context, config, scenario.duration)
        CheckVisited(loop.evaluator, diagram, context, [self._run.start])
        fed_at, blocks = loop.evaluator.program.fed, loop.evaluator.blocks
        self._at = {blocks[i].system.get_name(): x for (i, _), x in fed_at.items()}
        self._places, self._rows = loop.places, list[Array]()
        self._model = scenario, diagram, config
        self._heard, self._sent = f"{heard}_channel", f"{spoken}_packet_sent"

    def Follow(self, heard: Array, turn: int) -> Array:
        """Returns what is fed from now on; trust falls (1) or comes back (-1)."""
        self._faded = min(max(self._faded + turn, 0), self._num)
        self.trust = 1 - self._faded / self._num
        left = self._faded if turn < 0 else self._num - self._faded
        target = heard if turn < 0 else np.where(self._falls, 0.0, self.fed)
        self.fed = self.fed + (target - self.fed) / (left + 1) if left else target
        return self.fed

    def Advance(self, t: float) -> Array:
        """Simulates until t in s, and returns what is sent then."""
        run, row = self._run, None
        while row is None or run.time < t - SAME:
            _, rows, _ = run.Advance(t)
            run.Forget()
            if run.failure or run.error is not None:
                raise ArithmeticError(run.failure or run.error)
            if len(rows):  # At the start, before what happens there.
                row = rows[-1 if t else 0].copy()
        self._rows.append(row)
        return row[self._places[self._sent]]

    def Feed(self) -> None:
        """Feeds what Follow() returned."""
        self._run.Feed(self._at[self._heard], self.fed)
        if "hold" in self._at:
            row = self._rows[-1]
            p, v = (row[self._places[f"tool_{x}"]] for x in ("position", "velocity"))
            if self.trust == 1 or len(self._rows) == 1:
                self._place = p
            held = self._stiffness @ (self._place - p - self._lead * v)
            self._run.Feed(self._at["hold"], (1 - self.trust) * held)

    def Recording(self, time: Any, signals: Any, termination: str, why: str) -> Any:
        """Returns a run with signals (N, k) at times (N); its own ones among them."""
        rows, counts = np.array(self._rows[: time.size]), self._run.memory.counts
        own = {name: rows[:, x] for name, x in self._places.items() if len(rows)}
        outcome = Outcome(
            engine="compiled" if self._rows else "step",
            series=(time, signals | own, straight_steps(time)),
            steps=int(counts[STEPS]),
            derivative_evaluations=int(counts[EVALUATIONS]),
            wall_time=max(float(np.ptp(time)), 1e-9),
            termination=termination,
            reason=why,
            is_too_fast=False,
        )
        return MakeRecording(*self._model, outcome, [])
