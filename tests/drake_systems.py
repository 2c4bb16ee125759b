"""Every System of pydrake in a diagram: each class, and each way to visualise.

A table has a function for each class whose constructor takes arguments. Every other
class is made without arguments.
"""

import importlib
import inspect
import pkgutil
import sys
from functools import cache

import numpy as np
import pydrake
from drake import lcmt_scope
from pydrake import examples, manipulation, perception, visualization
from pydrake.common import RandomDistribution
from pydrake.common.value import Value
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    DrakeVisualizer,
    MakeRenderEngineVtk,
    Meshcat,
    MeshcatPointCloudVisualizer,
    MeshcatVisualizer,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.lcm import DrakeLcm
from pydrake.math import BarycentricMesh, RigidTransform
from pydrake.multibody import inverse_kinematics, meshcat
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ConnectContactResultsToDrakeVisualizer,
    ContactResultsToLcmSystem,
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
    Propeller,
    Wing,
)
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia
from pydrake.planning import RobotDiagram, RobotDiagramBuilder
from pydrake.symbolic import Variable
from pydrake.systems import controllers, lcm, primitives, rendering, sensors
from pydrake.systems.estimators import LuenbergerObserver
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    PortDataType,
    System,
    VectorSystem,
)
from pydrake.systems.perception import PointCloudConcatenation
from pydrake.systems.planar_scenegraph_visualizer import (
    ConnectPlanarSceneGraphVisualizer,
    PlanarSceneGraphVisualizer,
)
from pydrake.trajectories import PiecewisePolynomial

from teleop_drake.loops import TransportDelay
from teleop_drake.loops.framework.wiring import InputPorts

DELAY = 0.2
"""The delay in s of the loop beside each system."""

ONE = np.eye(1)

# The plants and scene graphs that a system refers to without keeping them alive.
_kept = []


@cache
def TheMeshcat():
    return Meshcat()


def WithoutSliders():
    TheMeshcat().DeleteAddedControls()
    return TheMeshcat()


def FinishArm(plant, num_links=1):
    """Adds links on hinges to a plant, and finalizes it."""
    parent = plant.world_frame()
    for i in range(num_links):
        name = f"link{i}"
        link = plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        hinge = RevoluteJoint(f"hinge{i}", parent, link.body_frame(), [0.0, 1.0, 0.0])
        plant.AddJointActuator(f"motor{i}", plant.AddJoint(hinge))
        if plant.geometry_source_is_registered():
            box = Box(0.1, 0.1, 0.1)
            color = [1.0, 0.0, 0.0, 1.0]
            plant.RegisterVisualGeometry(link, RigidTransform(), box, name, color)
        parent = link.body_frame()
    plant.Finalize()
    _kept.append(plant)
    return plant


def MakeArm(num_links=1):
    return FinishArm(MultibodyPlant(0.0), num_links)


def MakeArmInScene():
    plant = MultibodyPlant(0.0)
    plant.RegisterAsSourceForSceneGraph(MakeScene())
    return FinishArm(plant)


def MakeScene():
    scene_graph = SceneGraph()
    scene_graph.AddRenderer("renderer", MakeRenderEngineVtk(RenderEngineVtkParams()))
    _kept.append(scene_graph)
    return scene_graph


def MakeCameras():
    info = sensors.CameraInfo(8, 8, 1.0)
    clipping = ClippingRange(0.1, 10.0)
    core = RenderCameraCore("renderer", info, clipping, RigidTransform())
    return ColorRenderCamera(core), DepthRenderCamera(core, DepthRange(0.2, 5.0))


def MakeCamera():
    frame = MakeScene().world_frame_id()
    return sensors.RgbdSensor(frame, RigidTransform(), *MakeCameras())


def MakeAsyncCamera():
    scene_graph = MakeScene()
    return sensors.RgbdSensorAsync(
        *(scene_graph, scene_graph.world_frame_id(), RigidTransform()),
        *(10.0, 0.01, 0.01, *MakeCameras()),
    )


def MakeSelector():
    params = primitives.SelectorParams()
    params.inputs = [params.InputPortParams(name="u", size=2)]
    chosen = params.OutputSelection(input_port_index=0, input_offset=1)
    params.outputs = [params.OutputPortParams(name="y", selections=[chosen])]
    return primitives.Selector(params)


def MakeInverseKinematics():
    plant = MakeArm()
    parameters = inverse_kinematics.DifferentialInverseKinematicsParameters(1, 1)
    tip = plant.GetFrameByName("link0")
    return inverse_kinematics.DifferentialInverseKinematicsIntegrator(
        plant, tip, 0.1, parameters
    )


def MakeObserver():
    plant = primitives.LinearSystem(-ONE, ONE, ONE, 0 * ONE)
    return LuenbergerObserver(plant, plant.CreateDefaultContext(), ONE)


def MakeSymbolic():
    x = Variable("x")
    return primitives.SymbolicVectorSystem(state=[x], dynamics=[-x], output=[x])


def MakeSparseGain():
    sparse = importlib.import_module("scipy.sparse")
    return primitives.SparseMatrixGain(sparse.csc_matrix(ONE))


def MakeRobotDiagram():
    builder = RobotDiagramBuilder(0.0)
    FinishArm(builder.plant())
    return builder.Build()


def _Panda(kind):
    return lambda: kind(7, manipulation.PandaControlMode.kPosition)


def _Channel(kind):
    return lambda: kind.Make("CHANNEL", lcmt_scope, DrakeLcm("memq://"))


def _LinkOf(plant):
    return plant.GetBodyByName("link0")


_matrix = PiecewisePolynomial(ONE)
_line = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], [[0.0, 1.0]])

WITH_ARGUMENTS = {
    # pydrake.geometry and pydrake.visualization
    "MeshcatPointCloudVisualizer": lambda: MeshcatPointCloudVisualizer(
        TheMeshcat(), "points"
    ),
    "MeshcatVisualizer": lambda: MeshcatVisualizer(TheMeshcat()),
    "MeshcatPoseSliders": lambda: visualization.MeshcatPoseSliders(WithoutSliders()),
    "PlanarSceneGraphVisualizer": lambda: PlanarSceneGraphVisualizer(
        MakeScene(), show=False
    ),
    "VideoWriter": lambda: visualization.VideoWriter(filename="unused.gif"),
    # pydrake.manipulation
    "PandaCommandReceiver": _Panda(manipulation.PandaCommandReceiver),
    "PandaCommandSender": _Panda(manipulation.PandaCommandSender),
    "SchunkWsgTrajectoryGenerator": lambda: manipulation.SchunkWsgTrajectoryGenerator(
        2, 0
    ),
    "SimIiwaDriver": lambda: manipulation.SimIiwaDriver(
        manipulation.IiwaDriver(), MakeArm(7)
    ),
    # pydrake.multibody
    "ContactVisualizer": lambda: meshcat.ContactVisualizer(TheMeshcat()),
    "JointSliders": lambda: meshcat.JointSliders(WithoutSliders(), MakeArm()),
    "ContactResultsToLcmSystem": lambda: ContactResultsToLcmSystem(MakeArm()),
    "ExternallyAppliedSpatialForceMultiplexer": lambda: (
        ExternallyAppliedSpatialForceMultiplexer(2)
    ),
    "MultibodyPlant": MakeArm,
    "Propeller": lambda: Propeller(_LinkOf(MakeArm()).index()),
    "Wing": lambda: Wing(_LinkOf(MakeArm()).index(), 1.0),
    "DifferentialInverseKinematicsIntegrator": MakeInverseKinematics,
    "RobotDiagram": MakeRobotDiagram,
    # pydrake.perception and pydrake.systems.sensors
    "DepthImageToPointCloud": lambda: perception.DepthImageToPointCloud(
        sensors.CameraInfo(8, 8, 1.0)
    ),
    "PointCloudConcatenation": lambda: PointCloudConcatenation(["camera"]),
    "Accelerometer": lambda: sensors.Accelerometer(
        _LinkOf(MakeArm()), RigidTransform()
    ),
    "Gyroscope": lambda: sensors.Gyroscope(_LinkOf(MakeArm()), RigidTransform()),
    "RgbdSensor": MakeCamera,
    "RgbdSensorAsync": MakeAsyncCamera,
    "RgbdSensorDiscrete": lambda: sensors.RgbdSensorDiscrete(MakeCamera(), 0.1),
    "RotaryEncoders": lambda: sensors.RotaryEncoders([100]),
    "MultibodyPositionToGeometryPose": lambda: (
        rendering.MultibodyPositionToGeometryPose(MakeArmInScene())
    ),
    # pydrake.systems.controllers and estimators
    "InverseDynamics": lambda: controllers.InverseDynamics(MakeArm()),
    "InverseDynamicsController": lambda: controllers.InverseDynamicsController(
        MakeArm(), [1.0], [0.5], [0.5], has_reference_acceleration=False
    ),
    "JointStiffnessController": lambda: controllers.JointStiffnessController(
        MakeArm(), [1.0], [0.5]
    ),
    "PidControlledSystem": lambda: controllers.PidControlledSystem(
        examples.PendulumPlant(), 1.0, 1.0, 1.0
    ),
    "PidController": lambda: controllers.PidController([1.0], [1.0], [1.0]),
    "LuenbergerObserver": MakeObserver,
    # pydrake.systems.framework and lcm
    "VectorSystem": lambda: VectorSystem(1, 1, True),
    "LcmInterfaceSystem": lambda: lcm.LcmInterfaceSystem(DrakeLcm("memq://")),
    "LcmPublisherSystem": _Channel(lcm.LcmPublisherSystem),
    "LcmScopeSystem": lambda: lcm.LcmScopeSystem(1),
    "LcmSubscriberSystem": _Channel(lcm.LcmSubscriberSystem),
    # pydrake.systems.primitives
    "Adder": lambda: primitives.Adder(2, 1),
    "BarycentricMeshSystem": lambda: primitives.BarycentricMeshSystem(
        BarycentricMesh([{0.0, 1.0}]), np.array([[0.0, 1.0]])
    ),
    "ConstantValueSource": lambda: primitives.ConstantValueSource(Value("text")),
    "ConstantVectorSource": lambda: primitives.ConstantVectorSource([1.0]),
    "Demultiplexer": lambda: primitives.Demultiplexer(2),
    "DiscreteDerivative": lambda: primitives.DiscreteDerivative(1, 0.1),
    "DiscreteTimeDelay": lambda: primitives.DiscreteTimeDelay(0.1, 2, 1),
    "DiscreteTimeIntegrator": lambda: primitives.DiscreteTimeIntegrator(1, 0.1),
    "FirstOrderLowPassFilter": lambda: primitives.FirstOrderLowPassFilter(1.0),
    "Gain": lambda: primitives.Gain(2.0, 1),
    "Integrator": lambda: primitives.Integrator(1),
    "LinearTransformDensity": lambda: primitives.LinearTransformDensity(
        RandomDistribution.kGaussian, 1, 1
    ),
    "MatrixGain": lambda: primitives.MatrixGain(2 * ONE),
    "MultilayerPerceptron": lambda: primitives.MultilayerPerceptron([1, 2, 1]),
    "Multiplexer": lambda: primitives.Multiplexer(2),
    "PassThrough": lambda: primitives.PassThrough(1),
    "PortSwitch": lambda: primitives.PortSwitch(1),
    "RandomSource": lambda: primitives.RandomSource(
        RandomDistribution.kGaussian, 1, 0.1
    ),
    "Saturation": lambda: primitives.Saturation([-1.0], [1.0]),
    "Selector": MakeSelector,
    "SharedPointerSystem": lambda: primitives.SharedPointerSystem("held"),
    "Sine": lambda: primitives.Sine(1.0, 1.0, 0.0, 1),
    "SparseMatrixGain": MakeSparseGain,
    "StateInterpolatorWithDiscreteDerivative": lambda: (
        primitives.StateInterpolatorWithDiscreteDerivative(1, 0.1)
    ),
    "SymbolicVectorSystem": MakeSymbolic,
    "TrajectoryAffineSystem": lambda: primitives.TrajectoryAffineSystem(*6 * [_matrix]),
    "TrajectoryLinearSystem": lambda: primitives.TrajectoryLinearSystem(*4 * [_matrix]),
    "TrajectorySource": lambda: primitives.TrajectorySource(_line),
    "VectorLogSink": lambda: primitives.VectorLogSink(1),
    "WrapToSystem": lambda: primitives.WrapToSystem(1),
    "ZeroOrderHold": lambda: primitives.ZeroOrderHold(0.1, 1),
}
"""Functions that make a system of a class, by the name of the class."""

NOT_MADE = {
    "System",
    "Diagram",  # Drake refuses one without parts.
    "PyPlotVisualizer",  # Its subclasses draw.
    "_WrappedSystem",  # Made by a template of C++ only.
    # These two take a recipe of terms and a CollisionChecker of a whole robot.
    "DifferentialInverseKinematicsController",
    "DifferentialInverseKinematicsSystem",
    "QuadrotorGeometry",  # Drake downloads its mesh.
}
"""The names of the classes of which no system is made here."""

# Modules that need more than pydrake, or are parts of others.
_NO_MODULES = ("gym", "jupyter", "tutorials", "._", "meldis")


def FindClasses():
    """Returns every class of a System of floats in pydrake, by its name."""
    for module in pkgutil.walk_packages(
        pydrake.__path__, "pydrake.", lambda name: None
    ):
        if not any(part in module.name for part in _NO_MODULES):
            importlib.import_module(module.name)
    found = {}
    for name, module in list(sys.modules.items()):
        if not name.startswith("pydrake"):
            continue
        for value in list(vars(module).values()):
            if inspect.isclass(value) and issubclass(value, System):
                found[value.__name__] = value
    return found


def FindSystems():
    """Returns the names of the classes of which AddSystem() makes a system."""
    by_visualizers = {name for name in VISUALIZERS if name.endswith("Geometry")}
    return sorted(FindClasses().keys() - NOT_MADE - by_visualizers)


def _AddExampleWith(geometry, example, output):
    """Returns a function that adds one of Drake's examples and its picture."""

    def Add(builder):
        plant = builder.AddNamedSystem("example", example())
        Connect(builder, plant)
        scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
        geometry.AddToBuilder(builder, plant.GetOutputPort(output), scene_graph)

    return Add


def _AddArmWith(visualize):
    """Returns a function that adds an arm in a scene, and visualises it."""

    def Add(builder):
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        FinishArm(plant)
        visualize(builder, plant, scene_graph)

    return Add


def _AddCamera(builder, plant, scene_graph):
    renderer = MakeRenderEngineVtk(RenderEngineVtkParams())
    scene_graph.AddRenderer("renderer", renderer)
    frame = scene_graph.world_frame_id()
    camera = sensors.RgbdSensor(frame, RigidTransform(), *MakeCameras())
    builder.AddNamedSystem("camera", camera)
    builder.Connect(scene_graph.get_query_output_port(), camera.get_input_port())
    colors = builder.AddNamedSystem("colors", visualization.ColorizeLabelImage())
    builder.Connect(camera.label_image_output_port(), colors.get_input_port())


def _AddScope(builder, plant, scene_graph):
    lcm.LcmScopeSystem.AddToBuilder(
        builder=builder,
        lcm=DrakeLcm("memq://"),
        signal=plant.get_state_output_port(),
        channel="STATE",
        publish_period=0.1,
    )


def _AddTriad(builder, plant, scene_graph):
    visualization.AddFrameTriadIllustration(
        scene_graph=scene_graph, frame=_LinkOf(plant).body_frame(), plant=plant
    )


VISUALIZERS = {
    "AddDefaultVisualization": _AddArmWith(
        lambda builder, plant, scene_graph: visualization.AddDefaultVisualization(
            builder, TheMeshcat()
        )
    ),
    "ApplyVisualizationConfig": _AddArmWith(
        lambda builder, plant, scene_graph: visualization.ApplyVisualizationConfig(
            visualization.VisualizationConfig(), builder, meshcat=TheMeshcat()
        )
    ),
    "MeshcatVisualizer": _AddArmWith(
        lambda builder, plant, scene_graph: MeshcatVisualizer.AddToBuilder(
            builder, scene_graph, TheMeshcat()
        )
    ),
    "DrakeVisualizer": _AddArmWith(
        lambda builder, plant, scene_graph: DrakeVisualizer.AddToBuilder(
            builder, scene_graph, DrakeLcm("memq://")
        )
    ),
    "ConnectPlanarSceneGraphVisualizer": _AddArmWith(
        lambda builder, plant, scene_graph: ConnectPlanarSceneGraphVisualizer(
            builder, scene_graph, show=False
        )
    ),
    "ContactVisualizer": _AddArmWith(
        lambda builder, plant, scene_graph: meshcat.ContactVisualizer.AddToBuilder(
            builder, plant, TheMeshcat()
        )
    ),
    "ConnectContactResultsToDrakeVisualizer": _AddArmWith(
        lambda builder, plant, scene_graph: ConnectContactResultsToDrakeVisualizer(
            builder, plant, scene_graph, lcm=DrakeLcm("memq://")
        )
    ),
    "RgbdSensor": _AddArmWith(_AddCamera),
    "LcmScopeSystem": _AddArmWith(_AddScope),
    "AddFrameTriadIllustration": _AddArmWith(_AddTriad),
    "AcrobotGeometry": _AddExampleWith(
        examples.AcrobotGeometry, examples.AcrobotPlant, "acrobot_state"
    ),
    "CompassGaitGeometry": _AddExampleWith(
        examples.CompassGaitGeometry, examples.CompassGait, "floating_base_state"
    ),
    "PendulumGeometry": _AddExampleWith(
        examples.PendulumGeometry, examples.PendulumPlant, "state"
    ),
    "RimlessWheelGeometry": _AddExampleWith(
        examples.RimlessWheelGeometry, examples.RimlessWheel, "y1"
    ),
}
"""Functions that add something visible to a builder, by their names."""


def Connect(builder, system):
    """Connects each input of a system to a constant source.

    The inputs of a plant that are no vectors are left open, as usual.
    """
    has_plant = isinstance(system, MultibodyPlant | RobotDiagram)
    for port in InputPorts(system):
        if port.get_data_type() == PortDataType.kVectorValued:
            source = primitives.ConstantVectorSource(np.zeros(port.size()))
        elif has_plant:
            continue
        else:
            model = system.AllocateInputAbstract(port)
            source = primitives.ConstantValueSource(model)
        builder.Connect(builder.AddSystem(source).get_output_port(), port)


def AddSystem(builder, name):
    """Adds a system of a class, with a source for each input."""
    make = WITH_ARGUMENTS.get(name) or FindClasses()[name]
    system = builder.AddNamedSystem(name, make())
    Connect(builder, system)


def MakeBeside(add) -> Diagram:
    """Returns a diagram of x' = -x(t - DELAY), and of what is added beside it."""
    builder = DiagramBuilder()
    x = builder.AddNamedSystem("x", primitives.Integrator([1.0]))
    late = builder.AddNamedSystem("late", TransportDelay(DELAY, 1))
    back = builder.AddNamedSystem("back", primitives.Gain(-1.0, 1))
    for source, target in ((x, late), (late, back), (back, x)):
        builder.Connect(source.get_output_port(), target.get_input_port())
    add(builder)
    builder.ExportOutput(x.get_output_port(), "x")
    diagram = builder.Build()
    diagram.set_name("beside")
    return diagram
