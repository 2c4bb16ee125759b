"""Kinds of one's own: a control law, a robot, an operator and a task."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydrake.systems.framework import BasicVector, LeafSystem

from teleop_drake.loops.framework.validation import CheckNumber
from teleop_drake.loops.run.recording import Event
from teleop_drake.model.blocks.architectures import ControlLawConfig
from teleop_drake.model.blocks.architectures.direct_force import DirectForce
from teleop_drake.model.blocks.operators import OperatorConfig
from teleop_drake.model.blocks.robots import RobotConfig
from teleop_drake.model.tasks import Insertion, SpeedLimit
from teleop_drake.model.teleoperator import MakeTeleoperator


class BrakedForceLaw(LeafSystem):
    """F_c = F_h - damping v."""

    def __init__(self, *, num_axes: int, damping: float):
        LeafSystem.__init__(self)
        self.set_name("braked_force")
        names = ["haptic_force", "velocity_command", "tool_position", "tool_velocity"]
        names.append("environment_force")
        ports = {name: self.DeclareVectorInputPort(name, num_axes) for name in names}
        force = ports["haptic_force"]
        velocity = ports["tool_velocity"]
        self.DeclareVectorOutputPort(
            "control_force",
            num_axes,
            lambda context, output: output.SetFromVector(
                force.Eval(context) - damping * velocity.Eval(context)
            ),
            prerequisites_of_calc={force.ticket(), velocity.ticket()},
        )


@dataclass(kw_only=True, eq=False)
class BrakedForce(ControlLawConfig):
    """Direct force with local damping."""

    # N s/m, >= 0.
    damping: float = 0.2

    def Check(self, path: str, num_axes: int) -> None:
        CheckNumber(f"{path}.damping", self.damping, "N s/m", minimum=0)

    def MakeControlLaw(self, facts, path):
        return BrakedForceLaw(num_axes=facts.num_axes, damping=self.damping)


@dataclass(kw_only=True, eq=False)
class PuckConfig(RobotConfig):
    """A puck on air: a mass on n axes, without a MultibodyPlant."""

    # kg, > 0.
    mass: float = 1.0

    def Check(self, path):
        super().Check(path)
        CheckNumber(f"{path}.mass", self.mass, "kg", above=0)

    def MakeRobot(self):
        return Puck(self.start, self.mass)


class Puck(LeafSystem):
    """m dv/dt = F_c - F_e."""

    def __init__(self, start, mass):
        super().__init__()
        n = len(start)
        self._mass = mass
        self._forces = [
            self.DeclareVectorInputPort(name, n)
            for name in ("control_force", "environment_force")
        ]
        self.DeclareContinuousState(BasicVector([*start, *[0.0] * n]), n, n, 0)
        state = {self.xc_ticket()}
        for name, begin in (("tool_position", 0), ("tool_velocity", n)):
            self.DeclareVectorOutputPort(
                name,
                n,
                lambda context, output, begin=begin: output.SetFromVector(
                    self._State(context)[begin : begin + n]
                ),
                state,
            )
        self.DeclareVectorOutputPort(
            "tool_acceleration",
            n,
            lambda context, output: output.SetFromVector(self._Acceleration(context)),
            {port.ticket() for port in self._forces},
        )

    def _State(self, context):
        return context.get_continuous_state_vector().CopyToVector()

    def _Acceleration(self, context):
        control_force, environment_force = (port.Eval(context) for port in self._forces)
        return (control_force - environment_force) / self._mass

    def DoCalcTimeDerivatives(self, context, derivatives):
        v = np.split(self._State(context), 2)[1]
        derivatives.SetFromVector(np.concatenate([v, self._Acceleration(context)]))


class Fading(LeafSystem):
    """v_d = velocity exp(-t), whatever is felt."""

    def __init__(self, velocity):
        LeafSystem.__init__(self)
        n = velocity.size
        force = self.DeclareVectorInputPort("haptic_force", n)
        time = {self.time_ticket()}
        nothing = {self.nothing_ticket()}
        for name, size, compute, tickets in (
            ("velocity_command", n, lambda x: velocity * np.exp(-x.get_time()), time),
            ("force_command", n, force.Eval, {force.ticket()}),
            ("mode", 1, lambda x: [0.0], nothing),
        ):
            self.DeclareVectorOutputPort(
                name,
                size,
                lambda context, output, compute=compute: output.SetFromVector(
                    compute(context)
                ),
                tickets,
            )


@dataclass(kw_only=True, eq=False)
class FadingConfig(OperatorConfig):
    """An operator who loses interest."""

    def MakeOperator(self, *, start, contact_surface=None):
        return Fading(np.asarray(self.velocity, dtype=float))


class Reach(Insertion):
    """An insertion with a law, a limit, an event, a metric and a figure of its own."""

    units: ClassVar = {**Insertion.units, "path_length": "m"}

    def MakeDiagram(self, scenario):
        return MakeTeleoperator(scenario, control_law=DirectForce(num_axes=1))

    def MakeSpeedLimit(self, scenario):
        return SpeedLimit(speed=1.0, name="1 m/s")

    def FindEvents(self, recording):
        halfway = Event(name="halfway", time=float(recording.time[-1]) / 2)
        return sorted(
            [*super().FindEvents(recording), halfway], key=lambda event: event.time
        )

    def Metrics(self, recording):
        steps = np.linalg.norm(np.diff(recording["tool_position"], axis=0), axis=1)
        return {**super().Metrics(recording), "path_length": float(steps.sum())}

    def Particulars(self, recording):
        return {**super().Particulars(recording), "stretch": "short"}

    def Panels(self, recordings):
        return super().Panels(recordings)[:1]


def Damped(F_h, v_d, p, v, F_e, damping=1, offset=(0.0,)):
    """A plain function as a law: F_c = F_h + damping (v_d - v) + offset."""
    return F_h + damping * (v_d - v) + offset


def Demanding(F_h, v_d, p, v, F_e, gain):
    """A law whose gain has no default."""
    return gain * F_h


class Unconverted(BrakedForceLaw):
    """A LeafSystem that is named in a scenario as it is."""

    def __init__(self, num_axes, damping: float = 0.2, label="x", is_loud=False):
        if damping < 0:
            raise ValueError("no motor")
        BrakedForceLaw.__init__(self, num_axes=num_axes, damping=damping)


def TwoForces(F_h, v_d, p, v, F_e):
    return np.zeros(2)


def TooFew(F_h, v_d):
    return F_h


def KeywordOnly(F_h, v_d, p, v, F_e, *, damping=1.0):
    return F_h


def Clashing(F_h, v_d, p, v, F_e, time=1.0):
    return F_h * time


def Odd(F_h, v_d, p, v, F_e, table=dict):
    return F_h


def Worded(F_h, v_d, p, v, F_e, mode_name="x"):
    return F_h
