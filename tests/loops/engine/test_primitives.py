"""The kernels of Drake's own systems, and diagrams of them."""

import numpy as np
import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose
from pydrake.examples import (
    AcrobotPlant,
    PendulumPlant,
    QuadrotorPlant,
    VanDerPolOscillator,
)
from pydrake.math import BarycentricMesh
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Adder,
    AffineSystem,
    BarycentricMeshSystem,
    ConstantVectorSource,
    Demultiplexer,
    DiscreteDerivative,
    DiscreteTimeDelay,
    DiscreteTimeIntegrator,
    FirstOrderLowPassFilter,
    Gain,
    Integrator,
    LinearSystem,
    LogVectorOutput,
    MatrixGain,
    MultilayerPerceptron,
    Multiplexer,
    PassThrough,
    Saturation,
    Sine,
    TrajectorySource,
    WrapToSystem,
    ZeroOrderHold,
)
from pydrake.trajectories import PiecewisePolynomial
from wired import InSeries, Wired

from teleop_drake.loops.engine.block_kernels import KernelOf
from teleop_drake.loops.engine.check import Compare, KernelDisagrees
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.kernel import Kernel

rng = np.random.default_rng(3)
A, B, C, D = (rng.normal(size=size) for size in ((3, 3), (3, 2), (4, 3), (4, 2)))
NONE = np.zeros


PRIMITIVES = {
    "gain": lambda: Gain(k=[2.0, -1.0]),
    "matrix gain": lambda: MatrixGain(D),
    "adder": lambda: Adder(3, 2),
    "multiplexer": lambda: Multiplexer([2, 1, 3]),
    "demultiplexer": lambda: Demultiplexer([1, 2, 1]),
    "linear": lambda: LinearSystem(A, B, C, D),
    "linear without feedthrough": lambda: LinearSystem(A, B, C, NONE((4, 2))),
    "linear without input": lambda: LinearSystem(A, NONE((3, 0)), C, NONE((4, 0))),
    "discrete linear": lambda: LinearSystem(A / 5, B, C, D, 0.1),
    "affine": lambda: AffineSystem(A, B, [1.0, 2.0, 3.0], C, D, [1.0, -1.0, 0.5, 2.0]),
    "integrator": lambda: Integrator(3),
    "constant": lambda: ConstantVectorSource([1.0, -2.0]),
    "saturation": lambda: Saturation([-0.1, -0.2], [0.3, 0.1]),
    "pass through": lambda: PassThrough(2),
    "sine of time": lambda: Sine([1.0, 0.0], [3.0, 2.0], [0.1, 0.3], True),
    "sine of input": lambda: Sine([1.0, 3.0], [3.0, -1.0], [0.1, 0.0], False),
    "zero order hold": lambda: ZeroOrderHold(0.1, 2),
    "discrete delay": lambda: DiscreteTimeDelay(0.1, 3, 2),
    "discrete derivative": lambda: DiscreteDerivative(2, 0.1),
    "discrete integrator": lambda: DiscreteTimeIntegrator(2, 0.1),
    "low pass": lambda: FirstOrderLowPassFilter(0.2, 2),
    "perceptron": lambda: MultilayerPerceptron([2, 3, 1]),
    "pid": lambda: PidController([1.0, 2.0], [0.1, 0.2], [0.3, 0.4]),
    "pendulum": PendulumPlant,
    "acrobot": AcrobotPlant,
    "van der pol": VanDerPolOscillator,
    "quadrotor": QuadrotorPlant,
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("make", PRIMITIVES.values(), ids=PRIMITIVES)
def test_a_system_of_drake_has_a_kernel(make):
    CheckKernel(make())


def test_an_input_that_nothing_depends_on_may_be_connected():
    """Without state, and with D = 0, a LinearSystem puts out zeros."""
    silent = LinearSystem(
        NONE((0, 0)), NONE((0, 1)), NONE((2, 0)), NONE((2, 1)), time_period=0.0
    )
    diagram = Wired(
        {"source": ConstantVectorSource([1.0]), "silent": silent}, {"silent": "source"}
    )
    CheckKernel(diagram)


@pytest.mark.parametrize("num_dimensions", [1, 2, 3])
def test_a_mesh_is_interpolated_in_simplices_as_in_drake(num_dimensions):
    random = np.random.default_rng(num_dimensions)
    grids = [{-1.0, -0.2, 1.0}, {0.0, 0.3}, {-0.5, 0.1, 0.2, 2.0}][:num_dimensions]
    mesh = BarycentricMesh(grids)
    values = random.normal(size=(2, mesh.get_num_mesh_points()))
    block = BarycentricMeshSystem(mesh, values)
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, np.zeros(num_dimensions))
    evaluator = Evaluator(block, context, as_machine_code=True)
    # Inside, outside, on faces and at corners.
    points = [*random.uniform(-2, 3, (200, num_dimensions))]
    points += [mesh.get_mesh_point(i) for i in range(mesh.get_num_mesh_points())]
    points += [np.array([0.3, 0.3, 0.15])[:num_dimensions]]
    for point in points:
        block.get_input_port().FixValue(context, point)
        Compare(evaluator, block, context)
    with pytest.raises(UnsupportedSystem, match="two or more values"):
        KernelOf(BarycentricMeshSystem(BarycentricMesh([{0.0}]), [[1.0]]), context)


def test_a_block_without_a_kernel_is_named():
    block = TrajectorySource(PiecewisePolynomial([1.0]))
    block.set_name("path")
    with pytest.raises(UnsupportedSystem, match=r"Source 'path' .* trajectory"):
        CheckKernel(block)


@pytest.mark.parametrize("angle", [-20.0, -np.pi, 0.0, 1.5, np.pi, 9.0])
def test_angles_are_wrapped_as_in_drake(angle):
    """Drake does not tell the intervals of its block."""
    block = WrapToSystem(4)
    block.set_interval(0, -np.pi, np.pi)
    block.set_interval(1, 0.0, 2 * np.pi)
    block.set_interval(3, -7.3, -1.1)
    context = block.CreateDefaultContext()
    u = np.full(4, angle)
    block.get_input_port().FixValue(context, u)
    expected = block.get_output_port().Eval(context)
    y, _ = Evaluator(block, context).Evaluate(context)
    assert_allclose(y[:4], expected, rtol=0, atol=1e-14)
    assert y[2] == angle


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
    law = Wired(
        {
            "split": Demultiplexer(2),
            "gain": Gain(-30.0, 1),
            "damp": Gain(-4.0, 1),
            "add": Adder(2, 1),
        },
        {"gain": "split.y0", "damp": "split.y1", "add.u0": "gain", "add.u1": "damp"},
        {"force": "add"},
        inputs={"state": "split"},
    )

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
    wrong = {"wrong_spring": Spring(told=3.1)}
    diagram = Wired(wrong, {}, inputs={"position": "wrong_spring"})
    with pytest.raises(KernelDisagrees, match="wrong_spring: its kernel says force"):
        CheckKernel(diagram)


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
    spring = Spring(told=3.0)
    spring.Kernel = lambda: kernel
    parts = {"source": ConstantVectorSource([1.0]), "spring": spring}
    diagram = Wired(parts, InSeries(*parts))
    with pytest.raises(UnsupportedSystem, match=message):
        CheckKernel(diagram)
