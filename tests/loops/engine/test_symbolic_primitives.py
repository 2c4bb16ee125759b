"""Kernels that are made of the symbolic form of Drake's systems."""

import numpy as np
import pytest
from drake_systems import MakeArm
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose
from pydrake.examples import PendulumPlant, RimlessWheel
from pydrake.symbolic import Variable
from pydrake.systems import controllers
from pydrake.systems.primitives import Integrator, SymbolicVectorSystem
from wired import Wired

from teleop_drake.loops import simulate
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem

x = Variable("x")
u = Variable("u")


def halving(period):
    """x[n + 1] = x[n] / 2 + u[n], x[0] = 0."""
    return SymbolicVectorSystem(
        state=[x], input=[u], dynamics=[x / 2 + u], output=[x + 1], time_period=period
    )


def test_other_parameters_take_the_same_machine_code():
    plant = PendulumPlant()
    context = plant.CreateDefaultContext()
    plant.get_input_port().FixValue(context, [0.3])
    context.SetContinuousState([0.4, 0.2])
    first = Evaluator(plant, context, as_machine_code=True)
    plant.get_mutable_parameters(context).set_mass(2.0)
    other = Evaluator(plant, context, as_machine_code=True, like=first)
    assert other.function is first.function
    mass = 2.0
    length = 0.5
    damping = 0.1
    gravity = 9.81
    torque = 0.3 - damping * 0.2 - mass * gravity * length * np.sin(0.4)
    expected = [0.2, torque / (mass * length**2)]
    assert_allclose(other.Evaluate(context)[1], expected, rtol=1e-14)


def test_a_discrete_symbolic_system_steps():
    """Next to a continuous one Drake's own run ends with a violated contract."""
    diagram = Wired(
        {"steps": halving(0.1), "level": Integrator(1)},
        {"level": "steps", "steps": "steps"},
        {"held": "steps", "integral": "level"},
    )
    recording = simulate(diagram, duration=0.25)
    assert recording.solver.engine == "compiled"
    # x becomes 1.5 x + 1 at 0, 0.1 and 0.2 s.
    assert recording.signals["held"][-1, 0] == pytest.approx(1 + 4.75)
    integral = 0.1 * (1 + 1) + 0.1 * (1 + 2.5) + 0.05 * (1 + 4.75)
    assert recording.signals["integral"][-1, 0] == pytest.approx(integral)


def test_a_discrete_symbolic_system_is_compared_with_drake():
    CheckKernel(halving(0.1))


class OwnPendulum(PendulumPlant):
    """Another pendulum, whose symbolic form is that of its base."""

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector([0.0, 0.0])


@pytest.mark.parametrize("make", [OwnPendulum, RimlessWheel])
def test_a_system_without_a_symbolic_form_is_refused(make):
    system = make()
    system.set_name("plant")
    with pytest.raises(UnsupportedSystem, match=f"{make.__name__} 'plant' cannot"):
        CheckKernel(system)


@pytest.mark.parametrize("kind", ["InverseDynamics", "JointStiffnessController"])
def test_a_regulator_with_a_large_plant_inside_is_refused_at_once(kind):
    """Its symbolic form takes Drake seconds for eight joints, and hours for twelve."""
    plant = MakeArm(8)
    gains = [] if kind == "InverseDynamics" else [np.ones(8), np.ones(8)]
    regulator = getattr(controllers, kind)(plant, *gains)
    context = regulator.CreateDefaultContext()
    with pytest.raises(UnsupportedSystem, match="there are 16 states, too many"):
        Evaluator(regulator, context)
