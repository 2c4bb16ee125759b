"""LeafSystems in the styles in which people write them, none with a kernel.

READ are those that the package reads as they stand; REFUSED are those that it cannot
follow, with what it says; MISREAD are those that look right, and that Drake calls in
another way than they read.
"""

import collections
import functools
import math
import time
from dataclasses import dataclass

import numpy as np
from foreign.wiring import SerialArm
from pydrake.common.containers import namedview
from pydrake.common.value import AbstractValue
from pydrake.examples import PendulumParams, PendulumPlant
from pydrake.math import RotationMatrix_, wrap_to
from pydrake.math import cos as drake_cos
from pydrake.math import sin as drake_sin
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    JacobianWrtVariable,
    MultibodyForces,
    MultibodyForces_,
)
from pydrake.systems.framework import (
    BasicVector,
    EventStatus,
    LeafSystem,
    LeafSystem_,
    PublishEvent,
    TriggerType,
    UnrestrictedUpdateEvent,
    ValueProducer,
    VectorSystem,
    WitnessFunctionDirection,
)
from pydrake.systems.primitives import LinearSystem
from pydrake.systems.pyplot_visualizer import PyPlotVisualizer
from pydrake.systems.scalar_conversion import TemplateSystem
from pydrake.trajectories import PiecewisePolynomial

RATE = 0.7


class Block(LeafSystem):
    """A block with an input u of two elements and an output y of one.

    A subclass has a method calc(context, output), and whatever else it needs.
    """

    num_inputs = 2
    num_outputs = 1

    def __init__(self):
        LeafSystem.__init__(self)
        if self.num_inputs:
            self.u = self.DeclareVectorInputPort("u", self.num_inputs)
        self.declare()
        self.DeclareVectorOutputPort("y", self.num_outputs, self.calc)

    def declare(self):
        pass


class Sum(Block):
    def calc(self, context, output):
        output.SetFromVector([sum(self.u.Eval(context))])


class ByIndex(Block):
    def calc(self, context, output):
        u = self.EvalVectorInput(context, 0)
        output.SetAtIndex(0, u.GetAtIndex(0) * u[1] + u.size())


class ByName(Block):
    num_outputs = 2

    def calc(self, context, output):
        u = self.GetInputPort("u").EvalBasicVector(context).CopyToVector()
        output[0] = u[1]
        output[1] = -u[0]


class InPlace(Block):
    num_outputs = 2

    def calc(self, context, output):
        y = output.get_mutable_value()
        y[:] = self.get_input_port().Eval(context)
        y *= 2.0


class Clipped(Block):
    def calc(self, context, output):
        output.SetFromVector(np.clip(3 * self.u.Eval(context), -1.0, 1.0)[:1])


class DeadZone(Block):
    def calc(self, context, output):
        u = self.u.Eval(context)[0]
        if u > 0.2:
            y = u - 0.2
        elif u < -0.2:
            y = u + 0.2
        else:
            y = 0.0
        output[0] = y


class Logic(Block):
    def calc(self, context, output):
        a, b = self.u.Eval(context)
        is_inside = -0.5 < a < 0.5 and not b > 0.3
        output[0] = a if is_inside or b < -0.9 else float(b >= 0) + 0.1


class Clock(Block):
    num_inputs = 0

    def calc(self, context, output):
        t = context.get_time()
        output.SetFromVector([math.sin(2 * math.pi * t) + (1.0 if t >= 0.5 else 0.0)])


class SawTooth(Block):
    def calc(self, context, output):
        angle = (10 * self.u.Eval(context)[0] + np.pi) % (2 * np.pi) - np.pi
        output[0] = angle + np.mod(context.get_time(), 0.3) + math.fmod(angle, 0.7)


class Wrapped(Block):
    def calc(self, context, output):
        output[0] = wrap_to(4 * drake_sin(self.u.Eval(context)[0]), -1.0, 1.0)


class Minimal(Block):
    def calc(self, context, output):
        a, b = self.u.Eval(context)
        output[0] = max(a, b, 0.1) + min([a, b]) * abs(a) + np.hypot(a, b)


class Matrix(Block):
    num_outputs = 2

    def declare(self):
        self.K = np.array([[1.0, 2.0], [-3.0, 0.5]])

    def calc(self, context, output):
        x = self.u.Eval(context).reshape(2, 1)
        output.SetFromVector((self.K @ x - self.K.T.dot(x)).ravel())


class Solved(Block):
    num_outputs = 2

    def calc(self, context, output):
        a, b = self.u.Eval(context)
        M = np.array([[2.0 + a * a, b], [b, 3.0]])
        x = np.linalg.solve(M, [1.0, a])
        output.SetFromVector(x / np.linalg.norm(x) + np.linalg.inv(M)[0])


class Looked(Block):
    def declare(self):
        self.x = np.linspace(-1, 1, 7)
        self.y = self.x**2

    def calc(self, context, output):
        output[0] = np.interp(self.u.Eval(context)[0], self.x, self.y)


class Looped(Block):
    def declare(self):
        self.weights = [1.0, -2.0]

    def calc(self, context, output):
        total = 0.0
        for i, (w, x) in enumerate(zip(self.weights, self.u.Eval(context))):  # noqa: B905
            total += (i + 1) * w * x**2
        k = 0
        while k < 3:
            total = np.tanh(total)
            k += 1
        output.SetFromVector([total + sum(x for x in self.weights)])


class Helped(Block):
    gain = 3.0

    def calc(self, context, output):
        output.SetFromVector([self.law(*self.u.Eval(context)) + self.offset])

    def law(self, a, b=0.0, *, c=0.25):
        def square(x):
            return x * x

        return self.gain * square(a) + self.shifted(b) + c

    @staticmethod
    def shifted(b):
        return b + RATE

    @property
    def offset(self):
        return -self.gain


class Inherited(Helped):
    gain = 0.5

    def calc(self, context, output):
        super().calc(context, output)
        output[0] = 2 * output[0] + super().law(1.0)

    def law(self, a, b=0.0, *, c=0.1):
        return super(Inherited, self).law(b, a, c=c) + 1  # noqa: UP008


@dataclass(frozen=True)
class Gains:
    kp: float = 2.0
    kd: float = 0.3

    def law(self, e, v):
        return -self.kp * e - self.kd * v


class WithDataclass(Block):
    def declare(self):
        self.gains = Gains()

    def calc(self, context, output):
        output[0] = self.gains.law(*self.u.Eval(context))


class WithTable(Block):
    def declare(self):
        self.laws = {"cubic": lambda x: x**3, "linear": lambda x: 2 * x}
        self.chosen = "cubic"

    def calc(self, context, output):
        match self.chosen:
            case "cubic":
                k = 1.5
            case _:
                k = 0.0
        output[0] = k * self.laws[self.chosen](self.u.Eval(context)[0])


@functools.lru_cache
def factor(n):
    return 1.0 / n


class WithCachedFunction(Block):
    @functools.cached_property
    def offset(self):
        return 0.125

    def calc(self, context, output):
        output[0] = factor(4) * self.u.Eval(context)[0] + self.offset


def partial_block():
    """The callbacks are a partial, a lambda and a function in a function."""
    block = LeafSystem()
    u = block.DeclareVectorInputPort("u", 2)

    def calc(gain, context, output, *, offset):
        output.SetFromVector(gain * u.Eval(context) + offset)

    block.DeclareVectorOutputPort("y", 2, functools.partial(calc, 2.0, offset=0.5))
    block.DeclareVectorOutputPort(
        "z", 1, lambda context, output: output.SetAtIndex(0, u.Eval(context)[1] ** 3)
    )
    return block


class TwoOutputs(Block):
    def declare(self):
        self.DeclareVectorOutputPort("z", BasicVector(2), self.calc_z)

    def calc_z(self, context, output):
        output.SetFromVector(np.cross([*self.u.Eval(context), 1.0], [1, 2, 3])[:2])

    def calc(self, context, output):
        output[0] = self.GetOutputPort("z").Eval(context)[0] ** 2


class Cached(Block):
    def declare(self):
        self.entry = self.DeclareCacheEntry(
            "square",
            ValueProducer(
                allocate=lambda: AbstractValue.Make(np.zeros(2)), calc=self.square
            ),
        )

    def square(self, context, value):
        value.set_value(self.u.Eval(context) ** 2)

    def calc(self, context, output):
        output.SetFromVector([np.sum(self.entry.Eval(context))])


class Optional(Block):
    def declare(self):
        self.other = self.DeclareVectorInputPort("other", 1)

    def calc(self, context, output):
        extra = self.other.Eval(context)[0] if self.other.HasValue(context) else 5.0
        if self.EvalVectorInput(context, 1) is None:
            extra += 1
        output[0] = self.u.Eval(context)[0] + extra


class Parameters(Block):
    def declare(self):
        self.k = self.DeclareNumericParameter(BasicVector([2.0, 3.0]))

    def calc(self, context, output):
        k = context.get_numeric_parameter(self.k).value()
        output[0] = k @ self.u.Eval(context)


class Path(Block):
    num_outputs = 3

    def declare(self):
        self.path = PiecewisePolynomial.CubicShapePreserving(
            [0.1, 0.4, 0.6, 0.9], [[0.0, 1.0, 0.5, 0.7], [1.0, 0.0, 0.0, 2.0]]
        )
        self.rate = self.path.MakeDerivative()

    def calc(self, context, output):
        t = context.get_time()
        v = self.rate.value(t)
        a = self.path.EvalDerivative(t, 2)
        output.SetFromVector([self.path.value(t)[0, 0], v[1, 0], a[0, 0]])


class EnergyShaping(Block):
    """The swing-up law of courses, with a PendulumPlant inside."""

    def declare(self):
        self.plant = PendulumPlant()
        self.own = self.plant.CreateDefaultContext()
        params = PendulumParams()
        params.set_mass(0.8)
        self.own.get_mutable_numeric_parameter(0).SetFromVector(params.CopyToVector())
        self.wish = 1.1 * params.mass() * params.gravity() * params.length()

    def calc(self, context, output):
        theta, rate = self.u.Eval(context)
        self.own.SetContinuousState([theta, rate])
        params = self.own.get_numeric_parameter(0)
        energy = self.plant.EvalPotentialEnergy(self.own)
        energy += self.plant.EvalKineticEnergy(self.own)
        if abs(rate) > 0.1:
            output[0] = params.damping() * rate - 0.1 * rate * (energy - self.wish)
        else:
            output[0] = 0.0


class ModelInside(Block):
    """A model whose port is kept, as where a law predicts the rate of its plant."""

    num_outputs = 2

    def declare(self):
        A = [[0.0, 1.0], [-2.0, -0.3]]
        self.model = LinearSystem(A, [[0.0], [1.0]], np.eye(2), np.zeros((2, 1)))
        self.own = self.model.CreateDefaultContext()
        self.port = self.model.get_input_port()

    def calc(self, context, output):
        self.own.SetContinuousState(self.u.Eval(context))
        self.port.FixValue(self.own, [0.5])
        rate = self.model.EvalTimeDerivatives(self.own).CopyToVector()
        output.SetFromVector(rate + self.model.get_output_port().Eval(self.own))


class CancelsDynamics(Block):
    """The plant's own equations, in a Context that each call makes."""

    num_outputs = 2

    def declare(self):
        self.plant = SerialArm([0.5, 0.4], actuated=(0, 1))

    def calc(self, context, output):
        q = self.u.Eval(context)
        own = self.plant.CreateDefaultContext()
        self.plant.SetPositions(own, q)
        self.plant.SetVelocities(own, q[::-1])
        forces = MultibodyForces_(self.plant)
        self.plant.CalcForceElementsContribution(own, forces)
        torque = self.plant.CalcMassMatrixViaInverseDynamics(own) @ [0.3, -0.2]
        torque += self.plant.CalcBiasTerm(own) - forces.generalized_forces()
        torque -= 0.5 * self.plant.CalcGeneralizedForces(own, forces)
        torque -= self.plant.CalcGravityGeneralizedForces(own)
        output.SetFromVector(self.plant.MakeActuationMatrix().T @ torque)


class Reaches(Block):
    """A spring at a point of a plant inside, whose weight is carried."""

    num_outputs = 2

    def declare(self):
        self.plant = SerialArm([0.5, 0.4], actuated=(0, 1))
        self.own = self.plant.CreateDefaultContext()
        self.plant.get_body(BodyIndex(2)).SetMass(self.own, 1.7)
        self.tip = self.plant.get_body(BodyIndex(2)).body_frame()

    def calc(self, context, output):
        plant = self.plant
        world = plant.world_frame()
        q = self.u.Eval(context)
        arm = plant.GetModelInstanceByName("arm")
        x = np.concatenate([q, q[::-1]])
        plant.SetPositionsAndVelocities(self.own, arm, x)
        point = [0.1, 0.02, 0.3]
        J = plant.CalcJacobianTranslationalVelocity(
            self.own, JacobianWrtVariable.kV, self.tip, point, world, world
        )
        p = plant.CalcPointsPositions(self.own, self.tip, point, world).ravel()
        J_w = plant.CalcJacobianSpatialVelocity(
            self.own, JacobianWrtVariable.kV, self.tip, point, world, world
        )
        force = -3.0 * p - J @ plant.GetVelocities(self.own) + J_w[:3] @ q
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(self.own, forces)
        carried = plant.CalcInverseDynamics(self.own, np.array([0.1, 0.2]), forces)
        output.SetFromVector(J.T @ force + carried)


class InnerContextAsDefault(Block):
    """A Context of its own comes as a default and by a partial."""

    def declare(self):
        plant = PendulumPlant()
        own = plant.CreateDefaultContext()

        def energy(context, output, own=own, *, other):
            own.SetContinuousState(self.u.Eval(context))
            other.SetContinuousState(self.u.Eval(context)[::-1])
            output[0] = plant.EvalKineticEnergy(own) - plant.EvalKineticEnergy(other)

        self.calc = functools.partial(energy, other=plant.CreateDefaultContext())


class Twice(Sum):
    def calc(self, context, output):
        if not self.u.HasValue(context):
            return
        super().calc(context, output)
        output[0] = 2 * output[0]


class Switched(Block):
    """Two laws that are blocks themselves, as where one swings up and one balances."""

    def declare(self):
        self.swing = EnergyShaping()
        self.swing_context = self.swing.CreateDefaultContext()
        self.walk = Walk()
        self.walk_context = self.walk.CreateDefaultContext()
        self.twice = Twice()
        self.twice_context = self.twice.CreateDefaultContext()

    def calc(self, context, output):
        u = self.u.Eval(context)
        if abs(u[0]) < 0.5:
            self.walk.u.FixValue(self.walk_context, 2 * u)
            self.walk_context.SetTime(context.get_time())
            self.walk_context.SetContinuousState([u[1]])
            output.SetFromVector(self.walk.GetOutputPort("y").Eval(self.walk_context))
        else:
            self.swing.get_input_port().FixValue(self.swing_context, u)
            output[0] = self.swing.get_output_port().Eval(self.swing_context)[0]
            self.twice.get_input_port().FixValue(self.twice_context, u)
            output[0] += self.twice.get_output_port().Eval(self.twice_context)[0]


# With states.


class Walk(Block):
    """Its rate, output and numbers depend on all that a Context has."""

    def declare(self):
        self.DeclareContinuousState(1)
        self.DeclareNumericParameter(BasicVector([0.3]))

    def calc(self, context, output):
        x = context.get_continuous_state_vector()[0]
        gain = context.get_numeric_parameter(0)[0]
        output[0] = gain * x * self.u.Eval(context)[0] + context.get_time()

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.get_mutable_vector().SetAtIndex(0, self.u.Eval(context)[1])


State = namedview("State", ["angle", "rate"])


class Pendulum(Block):
    num_outputs = 2

    def declare(self):
        self.DeclareContinuousState(1, 1, 0)

    def calc(self, context, output):
        x = context.get_continuous_state()
        output[0] = x.get_generalized_position().GetAtIndex(0)
        output[1] = x.get_generalized_velocity()[0]

    def DoCalcTimeDerivatives(self, context, derivatives):
        x = State(context.get_continuous_state_vector().CopyToVector())
        u = self.u.Eval(context)
        derivatives.get_mutable_generalized_position().SetAtIndex(0, x.rate)
        rate = -np.sin(x.angle) - 0.1 * x.rate + u[0]
        derivatives.get_mutable_generalized_velocity().SetFromVector([rate])


class Named(Block):
    num_outputs = 2

    def declare(self):
        self.DeclareContinuousState(2)

    def calc(self, context, output):
        output.SetFromVector(context.get_continuous_state().CopyToVector())

    def DoCalcTimeDerivatives(self, context, derivatives):
        x = State(context.get_continuous_state_vector().value())
        d = State(np.zeros(2))
        d.angle = x.rate
        d.rate = -x.angle + self.u.Eval(context)[1]
        derivatives.get_mutable_vector().SetFromVector(d[:])


class Pid(Block):
    def declare(self):
        self.DeclareContinuousState(1)
        self.kp = 2.0
        self.ki = 0.5

    def calc(self, context, output):
        e, v = self.u.Eval(context)
        i = context.get_continuous_state_vector()[0]
        output.SetFromVector([self.kp * e + self.ki * i + 0.1 * v])

    def DoCalcTimeDerivatives(self, context, derivatives):
        x = context.get_continuous_state_vector().GetAtIndex(0)
        e = self.u.Eval(context)[0]
        is_wound_up = abs(x) > 0.2 and x * e > 0
        derivatives[0] = 0.0 if is_wound_up else e


class StatePort(LeafSystem):
    def __init__(self):
        super().__init__()
        self.DeclareContinuousState([0.3, 0.1])
        m = self.DeclareDiscreteState([1.0, 2.0, 3.0])
        self.DeclareStateOutputPort("x", self.DeclareContinuousState([0.3, 0.1]))
        self.DeclareStateOutputPort("m", m)

    def DoCalcTimeDerivatives(self, context, derivatives):
        x = context.get_continuous_state_vector().CopyToVector()
        derivatives.SetFromVector([x[1], -x[0]])


class Filter(Block):
    """Two groups of discrete states, and one update."""

    def declare(self):
        self.a = self.DeclareDiscreteState(2)
        self.b = self.DeclareDiscreteState([0.5])
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.update)

    def update(self, context, values):
        a = context.get_discrete_state(self.a).value()
        values.get_mutable_vector(self.a).SetFromVector(
            0.9 * a + 0.1 * self.u.Eval(context)
        )
        values.get_mutable_value(self.b)[0] += a[0]
        return EventStatus.Succeeded()

    def calc(self, context, output):
        output[0] = sum(context.get_discrete_state(self.a)[i] for i in range(2))
        output[0] += context.get_discrete_state().value(self.b)[0]


class TwoRates(Block):
    """A fast and a slow update, with offsets, and an unrestricted one."""

    num_outputs = 3

    def declare(self):
        for _ in range(3):
            self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.05, 0.02, self.fast)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=0.2, offset_sec=0.0, update=self.slow
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.2, 0.1, self.free)

    def fast(self, context, values):
        values.set_value(0, [self.u.Eval(context)[0]])

    def slow(self, context, values):
        values.get_mutable_vector(1)[0] = context.get_discrete_state(0)[0] + 1.0

    def free(self, context, state):
        state.get_mutable_discrete_state(2).SetFromVector([context.get_time()])

    def calc(self, context, output):
        m = [context.get_discrete_state(i).value()[0] for i in range(3)]
        output.SetFromVector(m)


class SameRate(Block):
    """Two updates at the same instants, the closures of one function."""

    num_outputs = 2

    def declare(self):
        self.DeclareDiscreteState(2)
        for i in range(2):

            def update(context, values, i=i):
                values[i] = context.get_discrete_state_vector()[i] + (i + 1)

            self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, update)

    def calc(self, context, output):
        output.SetFromVector(context.get_discrete_state_vector().CopyToVector())


class Held(Block):
    """It does nothing unless its input is large."""

    def declare(self):
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.update)

    def update(self, context, values):
        u = self.u.Eval(context)[0]
        if abs(u) < 0.4:
            return EventStatus.DidNothing()
        values[0] = u
        return EventStatus.Succeeded()

    def calc(self, context, output):
        output.SetFrom(context.get_discrete_state_vector())


class Sampled(Block):
    """A continuous state whose rate is held between two updates."""

    def declare(self):
        self.DeclareContinuousState(1)
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.update)

    def update(self, context, values):
        values.get_mutable_vector().SetFromVector(self.u.Eval(context)[:1])

    def DoCalcTimeDerivatives(self, context, derivatives):
        m = context.get_discrete_state(0).CopyToVector()
        derivatives.get_mutable_vector().SetFromVector(
            m - context.get_continuous_state_vector().CopyToVector()
        )

    def calc(self, context, output):
        output.SetFromVector(context.get_continuous_state_vector().CopyToVector())


class ContinuousVectors(VectorSystem):
    def __init__(self):
        VectorSystem.__init__(self, 2, 1, direct_feedthrough=False)
        self.DeclareContinuousState(1)

    def DoCalcVectorTimeDerivatives(self, context, u, x, rate):
        rate[:] = u[0] - u[1] * x

    def DoCalcVectorOutput(self, context, u, x, y):
        y[:] = 2 * x


class DiscreteVectors(VectorSystem):
    def __init__(self):
        VectorSystem.__init__(self, 2, 2, direct_feedthrough=True)
        self.DeclareDiscreteState(2)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.update)

    def update(self, context, values):
        x = context.get_discrete_state_vector().CopyToVector()
        values.set_value(0, 0.5 * x + self.EvalVectorInput(context, 0).CopyToVector())

    def DoCalcVectorOutput(self, context, u, x, y):
        y[:] = x + u


@TemplateSystem.define("Vehicle_")
def Vehicle_(T):
    class Impl(LeafSystem_[T]):
        """A planar vehicle with two rotors, whose second input may be left open."""

        def _construct(self, is_read=True, converter=None):
            LeafSystem_[T].__init__(self, converter)
            self.is_read = is_read
            self.DeclareVectorInputPort("u", 2)
            self.wind = self.DeclareVectorInputPort("other", 1)
            self.DeclareStateOutputPort("x", self.DeclareContinuousState(3, 3, 0))

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, other.is_read, converter=converter)

        def DoCalcTimeDerivatives(self, context, derivatives):
            x = context.get_continuous_state_vector().CopyToVector()
            u = self.EvalVectorInput(context, 0).CopyToVector()
            wind = self.wind.Eval(context)[0] if self.wind.HasValue(context) else 0.0
            sine = drake_sin(x[2])
            cosine = drake_cos(x[2])
            if not self.is_read:  # Nobody follows a matrix of Drake's.
                R = RotationMatrix_[T].MakeYRotation(x[2])
                sine = R.matrix()[0, 2]
                cosine = R.matrix()[0, 0]
            lift = (u[0] + u[1]) / 0.5
            turn = 12.5 * (u[0] - u[1])
            rates = [-sine * lift + wind, cosine * lift - 9.81, turn]
            derivatives.get_mutable_vector().SetFromVector([*x[3:], *rates])

    return Impl


def SymbolicVehicle():
    return Vehicle_[None](is_read=False)


READ = [
    Sum, ByIndex, ByName, InPlace, Clipped, DeadZone, Logic, Clock, SawTooth, Wrapped,
    Minimal, Matrix, Solved, Looked, Looped, Helped, Inherited, WithDataclass,
    WithTable, WithCachedFunction, partial_block, TwoOutputs, Cached, Optional,
    Parameters, Path, EnergyShaping, ModelInside, Pendulum, Named, Pid, Filter,
    CancelsDynamics, Reaches, Switched, Walk, InnerContextAsDefault, TwoRates, SameRate,
    Held, Sampled, ContinuousVectors, DiscreteVectors, Vehicle_[None], SymbolicVehicle,
]  # fmt: skip


# What cannot be followed.


class Refused(Block):
    def declare(self):
        self.integral = 0.0
        self.log = []
        self.buffer = np.zeros(3)
        self.queue = collections.deque()
        self.plant = MultibodyPlant(0.0)
        self.plant.Finalize()
        self.rng = np.random.default_rng(0)
        self.pendulum = PendulumPlant()
        self.own = self.pendulum.CreateDefaultContext()
        self.walk = Walk()
        self.walking = self.walk.CreateDefaultContext()
        self.arm = SerialArm([0.5, 0.4], actuated=(0, 1))
        self.armed = self.arm.CreateDefaultContext()


class Assigns(Refused):
    def calc(self, context, output):
        self.integral += 0.1 * self.u.Eval(context)[0]
        output[0] = self.integral


class Appends(Refused):
    def calc(self, context, output):
        self.log.append(context.get_time())
        output[0] = len(self.log)


class WritesIntoArray(Refused):
    def calc(self, context, output):
        self.buffer[0] = self.u.Eval(context)[0]
        output[0] = self.buffer.sum()


class Queues(Refused):
    def calc(self, context, output):
        self.queue.append(context.get_time())
        output[0] = self.queue[0]


class Draws(Refused):
    def calc(self, context, output):
        output[0] = np.random.rand()


class DrawsFromGenerator(Refused):
    def calc(self, context, output):
        output[0] = self.rng.normal()


class ReadsClock(Refused):
    def calc(self, context, output):
        output[0] = time.time()


class Prints(Refused):
    def calc(self, context, output):
        print("u is", self.u.Eval(context))
        output[0] = 0.0


class MakesText(Refused):
    def calc(self, context, output):
        text = f"{context.get_time():.3f} s"
        output[0] = len(text)


class Catches(Refused):
    def calc(self, context, output):
        try:
            output[0] = 1.0 / self.u.Eval(context)[0]
        except ZeroDivisionError:
            output[0] = 0.0


class Raises(Refused):
    def calc(self, context, output):
        if self.u.Eval(context)[0] > 10.0:
            raise ValueError("too large")
        output[0] = 0.0


class ReadsFile(Refused):
    def calc(self, context, output):
        with open(__file__) as file:
            output[0] = len(file.read())


class HasPlant(Refused):
    def calc(self, context, output):
        output[0] = self.plant.CalcTotalMass(self.plant.CreateDefaultContext())


class SetsNoVelocity(Refused):
    def calc(self, context, output):
        self.arm.SetPositions(self.armed, self.u.Eval(context))
        output.SetFromVector(self.arm.CalcBiasTerm(self.armed)[:1])


class SetsNoState(Refused):
    def calc(self, context, output):
        output[0] = self.pendulum.EvalKineticEnergy(self.own)


class SetsNoTime(Refused):
    def calc(self, context, output):
        self.walking.SetContinuousState([0.2])
        self.walk.u.FixValue(self.walking, self.u.Eval(context))
        output.SetFromVector(self.walk.get_output_port().Eval(self.walking))


class CountsInGlobal(Refused):
    def calc(self, context, output):
        global RATE
        RATE += 1
        output[0] = RATE


class CountsInClass(Refused):
    count = 0

    def calc(self, context, output):
        type(self).count += 1
        output[0] = self.count


class LeavesOut(Refused):
    num_outputs = 2

    def calc(self, context, output):
        output[0] = 1.0


class EachStep(Refused):
    def declare(self):
        self.DeclareDiscreteState(1)
        self.DeclarePerStepDiscreteUpdateEvent(self.update)

    def update(self, context, values):
        values[0] = context.get_discrete_state(0)[0] + 1

    def calc(self, context, output):
        output[0] = context.get_discrete_state(0)[0]


class EachStepAndPeriodic(EachStep):
    def declare(self):
        super().declare()
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.update)


class Publishes(Refused):
    def declare(self):
        super().declare()
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self.publish)

    def publish(self, context):
        self.log.append(context.get_time())

    def calc(self, context, output):
        output[0] = 1.0


class EndsRun(EachStep):
    def declare(self):
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.end)

    def end(self, context, values):
        if context.get_time() > 0.35:
            return EventStatus.ReachedTermination(self, "enough")
        return EventStatus.Succeeded()


class ChangesAndDoesNothing(EachStep):
    def declare(self):
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.both)

    def both(self, context, values):
        values[0] = context.get_time()
        return EventStatus.DidNothing()


class Resets(Refused):
    def declare(self):
        self.DeclareContinuousState(1)
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.1, 0.0, self.reset)

    def reset(self, context, state):
        state.get_mutable_continuous_state().SetFromVector([0.0])

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector([1.0])

    def calc(self, context, output):
        output.SetFromVector(context.get_continuous_state_vector().CopyToVector())


class SecondOfTwo(Refused):
    """The first event can be followed, the second one counts on self."""

    def declare(self):
        self.count = 0
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.good)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.0, self.bad)

    def good(self, context, values):
        values[0] = 1.0

    def bad(self, context, values):
        self.count += 1

    def calc(self, context, output):
        output[0] = context.get_discrete_state(0)[0]


class Watches(Resets):
    def declare(self):
        self.DeclareContinuousState(1)
        self.full = self.MakeWitnessFunction(
            "full",
            WitnessFunctionDirection.kNegativeThenNonNegative,
            lambda context: context.get_continuous_state_vector()[0] - 0.5,
            UnrestrictedUpdateEvent(lambda context, event, state: None),
        )

    def DoGetWitnessFunctions(self, context):
        return [self.full]


class HasAbstractState(Refused):
    def declare(self):
        self.DeclareAbstractState(AbstractValue.Make([]))

    def calc(self, context, output):
        output[0] = len(context.get_abstract_state(0).get_value())


REFUSED = {
    Assigns: r"calc\(\), line \d+: it assigns to self.integral; declare a state",
    Appends: r"calc\(\), line \d+: it changes a list .*; declare a state",
    WritesIntoArray: r"line \d+: .* read-only; declare a state",
    Queues: r"a call of self.queue.append\(\); declare a state",
    Draws: "RandomSource",
    DrawsFromGenerator: r"self.rng.normal\(\)",
    ReadsClock: r"context.get_time\(\)",
    Prints: r"print\(\)",
    MakesText: "it makes text .*; print in an event",
    Catches: "catches errors",
    Raises: "too large",
    ReadsFile: r"calc\(\), line \d+: ",
    HasPlant: r"it calls CalcTotalMass\(\) of a plant inside; connect it",
    SetsNoVelocity: "it does not set the velocities of a plant inside",
    SetsNoState: "that it has not set",
    SetsNoTime: "does not set the time of a block inside",
    CountsInGlobal: "global variable",
    CountsInClass: r"a call of type\(\)",
    LeavesOut: "element 1",
    EachStep: r"update\(\) happens at every step",
    EachStepAndPeriodic: r"update\(\)",
    Publishes: r"publish\(\) publishes",
    EndsRun: "may end the run",
    ChangesAndDoesNothing: "DidNothing",
    Resets: "changes the continuous state",
    SecondOfTwo: r"bad\(\), line \d+: it assigns to self.count",
    Watches: "witness functions",
    HasAbstractState: "not a vector",
}


# What looks right.


class DeclaresNoTime(LeafSystem):
    """Drake evaluates the output once, since it is said to depend on nothing."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort("y", 1, self.calc, {self.nothing_ticket()})

    def calc(self, context, output):
        output[0] = context.get_time()


class DeclaresNoInput(Block):
    """Drake keeps the output, since it is said to depend on the state only."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.u = self.DeclareVectorInputPort("u", 2)
        self.DeclareContinuousState(1)
        self.DeclareVectorOutputPort("y", 1, self.calc, {self.all_parameters_ticket()})

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector([1.0])

    def calc(self, context, output):
        output[0] = self.u.Eval(context)[0]


MISREAD = [DeclaresNoTime, DeclaresNoInput]


class Sliders(LeafSystem):
    """Numbers that a person drags in Meshcat, as the notebooks of courses have."""

    def __init__(self, meshcat, names):
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._names = names
        self.DeclareVectorOutputPort("values", len(names), self.calc)

    def calc(self, context, output):
        for i, name in enumerate(self._names):
            output[i] = self._meshcat.GetSliderValue(name)


# Sinks.


class Logger(LeafSystem):
    """It has no output, and keeps what it receives."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("u", 2)
        self.log = []
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self.publish)

    def publish(self, context):
        self.log.append(self.get_input_port().Eval(context))


class Monitor(Logger):
    """It ends the run."""

    def publish(self, context):
        if context.get_time() > 0.35:
            return EventStatus.ReachedTermination(self, "enough")
        return EventStatus.Succeeded()


class Picture(PyPlotVisualizer):
    """It draws with matplotlib, as the notebooks of courses do."""

    def __init__(self):
        PyPlotVisualizer.__init__(self, show=False)
        self.DeclareVectorInputPort("u", 2)

    def draw(self, context):
        self.ax.plot(*self.get_input_port().Eval(context), "k.")


class Drawing(LeafSystem):
    """It publishes at each step, from an event."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("u", 2)
        self.num_drawn = 0
        self.DeclarePerStepEvent(
            PublishEvent(trigger_type=TriggerType.kPerStep, callback=self.draw)
        )

    def draw(self, context, event):
        self.num_drawn += 1
