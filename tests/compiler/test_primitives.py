"""The kernels of Drake's own blocks, and diagrams of them."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Adder,
    AffineSystem,
    ConstantVectorSource,
    Demultiplexer,
    Gain,
    Integrator,
    LinearSystem,
    LogVectorOutput,
    MatrixGain,
    Multiplexer,
    PassThrough,
    Saturation,
    Sine,
    WrapToSystem,
    ZeroOrderHold,
)

from teleop_drake.compiler.check import CheckKernel, KernelDisagrees
from teleop_drake.compiler.flatten import UnsupportedSystem
from teleop_drake.kernel import Kernel

rng = np.random.default_rng(3)
A, B, C, D = (rng.normal(size=size) for size in ((3, 3), (3, 2), (4, 3), (4, 2)))
NONE = np.zeros


def test_a_primitive_has_a_kernel():
    for block in [
        Gain(k=[2.0, -1.0]),
        MatrixGain(D),
        Adder(3, 2),
        Multiplexer([2, 1, 3]),
        Demultiplexer([1, 2, 1]),
        LinearSystem(A, B, C, D),
        LinearSystem(A, B, C, NONE((4, 2))),
        LinearSystem(A, NONE((3, 0)), C, NONE((4, 0))),
        AffineSystem(A, B, rng.normal(size=3), C, D, rng.normal(size=4)),
        Integrator(3),
        ConstantVectorSource([1.0, -2.0]),
        Saturation([-0.1, -0.2], [0.3, 0.1]),
        PassThrough(2),
        Sine([1.0, -2.0, 0.0, 3.0], [3.0, 0.0, 2.0, 1.0], [0.1, 0.2, 0.3, 0.0], True),
        Sine([1.0, 3.0], [3.0, -1.0], [0.1, 0.0], False),
        ZeroOrderHold(0.1, 2),
        LinearSystem(A / 5, B, C, D, 0.1),
    ]:
        CheckKernel(block)


def test_a_block_without_a_kernel_is_named():
    block = WrapToSystem(1)
    block.set_name("turns")
    with pytest.raises(UnsupportedSystem, match=r"System 'turns' .* offers no kernel"):
        CheckKernel(block)


def slider(effort_limit):
    plant = MultibodyPlant(0.0)
    plant.set_name("plant")
    carriage = plant.AddRigidBody(
        "carriage", SpatialInertia(0.5, [0, 0, 0], UnitInertia.SolidBox(1, 1, 1))
    )
    rail = plant.AddJoint(
        PrismaticJoint("rail", plant.world_frame(), carriage.body_frame(), [1, 0, 0])
    )
    plant.AddJointActuator("motor", rail, effort_limit)
    plant.Finalize()
    return plant


@pytest.mark.parametrize("effort_limit", [100.0, 0.1])
def test_a_nested_diagram_flattens(effort_limit):
    """A motor that may be limited drives a slider, by a law in a diagram of its own."""
    inner = DiagramBuilder()
    split = inner.AddNamedSystem("split", Demultiplexer(2))
    gain = inner.AddNamedSystem("gain", Gain(-30.0, 1))
    damp = inner.AddNamedSystem("damp", Gain(-4.0, 1))
    add = inner.AddNamedSystem("add", Adder(2, 1))
    inner.Connect(split.get_output_port(0), gain.get_input_port())
    inner.Connect(split.get_output_port(1), damp.get_input_port())
    inner.Connect(gain.get_output_port(), add.get_input_port(0))
    inner.Connect(damp.get_output_port(), add.get_input_port(1))
    inner.ExportInput(split.get_input_port(), "state")
    inner.ExportOutput(add.get_output_port(), "force")
    law = inner.Build()

    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", slider(effort_limit))
    builder.AddNamedSystem("law", law)
    builder.Connect(plant.get_state_output_port(), law.get_input_port())
    builder.Connect(law.get_output_port(), plant.get_actuation_input_port())
    builder.ExportInput(plant.get_applied_generalized_force_input_port(), "push")
    LogVectorOutput(plant.get_state_output_port(), builder).set_name("log")
    CheckKernel(builder.Build())


class Spring(LeafSystem):
    def __init__(self, told):
        LeafSystem.__init__(self)
        self._told = told
        self._position = self.DeclareVectorInputPort("position", 1)
        self.DeclareContinuousState(1)
        self.DeclareVectorOutputPort("force", 1, self._CalcForce)

    def _CalcForce(self, context, output):
        output.SetFromVector(spring_force(3.0, self._position.Eval(context)))

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.get_mutable_vector().SetFromVector(self._position.Eval(context))

    def Kernel(self):
        return Kernel(
            parameters={"stiffness": self._told},
            outputs={"force": (spring_force, "stiffness", "position")},
            rate="position",
        )


def spring_force(stiffness, x):
    return stiffness * x


def test_a_block_of_ones_own_is_checked():
    block = Spring(told=3.0)
    CheckKernel(block)
    wrong = Spring(told=3.1)
    wrong.set_name("wrong_spring")
    builder = DiagramBuilder()
    builder.AddNamedSystem("wrong_spring", wrong)
    builder.ExportInput(wrong.get_input_port(), "position")
    with pytest.raises(KernelDisagrees, match="wrong_spring: its kernel says force"):
        CheckKernel(builder.Build())


@pytest.mark.parametrize(
    ("kernel", "message"),
    [
        (Kernel(outputs={"force": "position"}), "no rate"),
        (
            Kernel(outputs={"force": "state"}, rate="state"),
            "nothing from the input position",
        ),
    ],
)
def test_a_kernel_that_forgets_its_state_or_an_input_is_refused(kernel, message):
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", ConstantVectorSource([1.0]))
    spring = builder.AddNamedSystem("spring", Spring(told=3.0))
    spring.Kernel = lambda: kernel
    builder.Connect(source.get_output_port(), spring.get_input_port())
    with pytest.raises(UnsupportedSystem, match=message):
        CheckKernel(builder.Build())
