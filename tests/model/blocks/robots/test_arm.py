"""Arms from model files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.geometry import Mesh, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia

from teleop_drake.cli import main
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.robots import ArmConfig, FactsOfRobot, TwoLinkArmConfig
from teleop_drake.model.blocks.robots import __file__ as robots_file
from teleop_drake.model.blocks.robots.base import TellingShapes
from teleop_drake.model.blocks.robots.inertias import LinkWithoutInertia
from teleop_drake.model.blocks.robots.inverse_kinematics import ToolJacobian
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.task_recording import LoadRecording

DIAGRAMS = Path(__file__).parents[4] / "diagrams"
URDF = DIAGRAMS / "own_arm.urdf"
TASK = str(DIAGRAMS / "own_arm.yaml")
PLANAR = Path(robots_file).parents[2] / "models" / "two_link_arm.sdf"
START = [0.45, 0.0, 0.2]
SHORT = ("--duration", "0.2", "--quiet")


def arm(**fields):
    return ArmConfig(**{"file": str(URDF), "start": START, **fields})


def tool_position(config):
    robot = config.MakeRobot()
    return robot.GetOutputPort("tool_position").Eval(robot.CreateDefaultContext())


# The pose.


@pytest.mark.parametrize("start", [START, [0.5, 0.1], [-0.5]])
def test_it_starts_where_it_should(start):
    """Also with fewer axes than joints."""
    config = arm(start=start)
    config.Check("robot")
    assert_allclose(tool_position(config), start, rtol=0, atol=1e-12)
    assert FactsOfRobot(config.MakeRobot()).inertia.shape == (len(start),) * 2


@pytest.mark.parametrize("elbow, posture", [("down", [0, 1.0]), ("up", [0, -1.0])])
def test_it_is_the_two_link_arm_from_its_file(elbow, posture):
    """The posture decides which of the two poses it is."""
    start = [0.85, 0.1]
    expected = TwoLinkArmConfig(start=start, elbow=elbow)
    config = arm(file=str(PLANAR), start=start, posture=posture)
    q = config.JointPositions(start)
    assert_allclose(q, expected.JointPositions(start), atol=1e-9)
    told = FactsOfRobot(config.MakeRobot())
    robot = FactsOfRobot(expected.MakeRobot())
    assert_allclose(told.inertia, robot.inertia, rtol=1e-8)


def test_free_joints_stay_near_the_posture():
    """No pose with the tool there is nearer to it."""
    posture = np.array([0.2, -0.7, 1.5])
    config = arm(start=[0.5], posture=posture)
    q = config.JointPositions([0.5])
    plant = config.LoadPlant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    J = ToolJacobian(plant, context, 1)
    # The step from the posture is along the gradient of the tool's position.
    step = q - posture
    assert_allclose(np.cross(step, J[0]), 0, atol=1e-5)


@pytest.mark.parametrize("gravity, weight", [(None, 0.0), ([0.0, 0.0, -9.81], 1.0)])
def test_gravity_is_compensated_unless_it_is_given(gravity, weight):
    config = arm(gravity=gravity)
    plant = config.LoadPlant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, config.JointPositions(START))
    torques = plant.CalcGravityGeneralizedForces(context)
    assert (np.abs(torques).max() > 0.5) == bool(weight)


# The file.


def changed(tmp_path, *changes, source=URDF, name="changed.urdf"):
    text = source.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / name
    path.write_text(text)
    return str(path)


def test_another_link_may_be_the_tool(tmp_path):
    file = changed(tmp_path, ('"tool"', '"flange"'))
    config = arm(file=file, tool_frame="flange")
    assert_allclose(tool_position(config), START, atol=1e-12)


def test_a_frame_may_be_the_tool(tmp_path):
    """The tool of the SDF is a frame and no link, 5 cm before the tip."""
    start = PLANAR.read_text().index('<link name="tool">')
    text = PLANAR.read_text()
    end = text.index("</link>", start) + len("</link>")
    frame = '<frame name="tool" attached_to="lower_link"><pose>0.7 0 0 0 0 0</pose>'
    text = text[:start] + frame + "</frame>" + text[end:]
    begin = text.index('<joint name="tool_weld"')
    text = text[:begin] + text[text.index("</joint>", begin) + len("</joint>") :]
    path = tmp_path / "frame.sdf"
    path.write_text(text)
    config = arm(file=str(path), start=[0.85, 0.0], posture=[-0.5, 1.0])
    assert_allclose(tool_position(config), [0.85, 0.0], atol=1e-12)
    assert FactsOfRobot(config.MakeRobot()).inertia is not None


def test_a_file_may_name_a_file_beside_it(tmp_path):
    """Text that names no file is parsed as text, which Drake does faster."""
    (tmp_path / "post.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh = "<mesh><uri>post.obj</uri></mesh>"
    visual = f'<visual name="own"><geometry>{mesh}</geometry></visual>'
    text = PLANAR.read_text().replace("</link>", f"{visual}</link>", 1)
    path = tmp_path / "arm.sdf"
    path.write_text(text)
    config = arm(file=str(path), start=[0.85, 0.0], posture=[-0.5, 1.0])
    assert_allclose(tool_position(config), [0.85, 0.0], atol=1e-12)
    scene_graph = SceneGraph()
    with TellingShapes(scene_graph):
        config.LoadPlant()
    inspector = scene_graph.model_inspector()
    shapes = [inspector.GetShape(i) for i in inspector.GetAllGeometryIds()]
    assert sum(isinstance(shape, Mesh) for shape in shapes) == 1


def test_an_arm_may_stand_elsewhere(tmp_path):
    """What is joined to the world is not put on its origin."""
    weld = (
        '<link name="world"/><joint name="stand" type="fixed"><parent link="world"/>'
        '<child link="base"/><origin xyz="0 1 0"/></joint><link name="column">'
    )
    file = changed(tmp_path, ('<link name="column">', weld))
    moved = arm(file=file, start=[0.45, 1.0, 0.2])
    assert_allclose(
        moved.JointPositions(moved.start), arm().JointPositions(START), atol=1e-9
    )


LOOP = (
    '<joint name="loop" type="revolute"><parent link="base"/><child link="forearm"/>'
    '<axis xyz="0 1 0"/><limit effort="1" velocity="1"/></joint><joint name="wrist"'
)


@pytest.mark.parametrize(
    "change, message",
    [
        (('"tool"', '"hand"'), "robot.tool_frame = 'tool': must be a frame of the mod"),
        (('<joint name="turn"/>', '<joint name="elbow"/>'), "one actuator for each"),
        (("</robot>", ""), "robot.file = '.*': must be a model of one open chain"),
        (
            ('<joint name="wrist"', LOOP),
            "robot.file = '.*': must be a model of one open",
        ),
        (
            ("<dynamics", '<mimic joint="turn"/><dynamics'),
            r"robot.locked = \[\]: must be with elbow, shoulder, turn, which the",
        ),
        (("</robot>", "<loop_joint/></robot>"), "without constraints .loop_joint"),
    ],
)
def test_files_that_are_no_arm(change, message, tmp_path):
    config = arm(file=changed(tmp_path, change))
    with pytest.raises(ScenarioError, match=message) as error:
        config.Check("robot")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("link", ["column", "upper_arm", "forearm"])
def test_a_link_without_inertia_is_named(link, tmp_path):
    """Only the last joint moves nothing else: the other two get motors, not masses."""
    text = URDF.read_text()
    begin = text.index(f'<link name="{link}">')
    end = text.index("</link>", begin)
    path = tmp_path / "light.urdf"
    path.write_text(f'{text[:begin]}<link name="{link}">{text[end:]}')
    config = arm(file=str(path))
    if link != "forearm":
        config.Check("robot")
        return
    message = rf"robot\.file = '.*': .* \(`inertial`\) of the link '{link}', which"
    with pytest.raises(ScenarioError, match=message) as error:
        config.Check("robot")
    assert "\n" not in str(error.value)


def test_a_massless_link_between_two_axes_in_line_is_named():
    """Its joints turn against each other without moving the last link."""
    plant = MultibodyPlant(0.0)
    parent = plant.world_frame()
    for name, mass in (("between", 0.0), ("last", 1.0)):
        inertia = SpatialInertia(mass, np.zeros(3), UnitInertia(0.1, 0.1, 0.1))
        link = plant.AddRigidBody(name, inertia)
        joint = RevoluteJoint(name, parent, link.body_frame(), [0.0, 0.0, 1.0])
        plant.AddJoint(joint)
        parent = link.body_frame()
    plant.Finalize()
    assert LinkWithoutInertia(plant, plant.CreateDefaultContext()) == "between"


def transmissions():
    """The file before its motors, what is said of each of them, and the end."""
    text = URDF.read_text()
    begin = text.index('<transmission name="turn')
    end = text.index("</robot>")
    parts = text[begin:end].split("</transmission>")
    return text[:begin], [f"{x}</transmission>" for x in parts[:-1]], text[end:]


def with_motors(tmp_path, choose):
    """Returns the file with motors that a function chooses from its own."""
    head, motors, tail = transmissions()
    path = tmp_path / "other.urdf"
    path.write_text(head + "".join(choose(motors)) + tail)
    return str(path)


def test_a_joint_without_a_motor(tmp_path):
    file = with_motors(tmp_path, lambda motors: motors[:2])
    message = "one actuator for each joint.* not 2 actuators for 3 joint velocities"
    with pytest.raises(ScenarioError, match=message):
        arm(file=file).Check("robot")
    plant = arm(file=file, add_motors=True).LoadPlant()
    assert_array_equal(plant.MakeActuationMatrix(), np.eye(3))


def test_two_motors_at_a_joint(tmp_path):
    file = with_motors(
        tmp_path, lambda motors: [*motors, motors[0].replace("turn_", "second_")]
    )
    with pytest.raises(ScenarioError, match="not 4 actuators for 3 joint velocities"):
        arm(file=file).Check("robot")


def test_motors_may_have_any_order(tmp_path):
    """Each gets the torque of its own joint, by either engine."""
    file = with_motors(tmp_path, lambda motors: [motors[k] for k in (2, 0, 1)])
    rates = []
    for config in (arm(), arm(file=file), arm(file=file, hold="posture")):
        robot = config.MakeRobot()
        context = robot.CreateDefaultContext()
        robot.GetInputPort("control_force").FixValue(context, [1.0, 2.0, 3.0])
        robot.GetInputPort("environment_force").FixValue(context, np.zeros(3))
        rates.append(robot.EvalTimeDerivatives(context).CopyToVector())
        CheckKernel(robot, num_states=2)
    assert_allclose(rates[1:], [rates[0]] * 2, atol=1e-12)


@pytest.mark.parametrize(
    "fields, message",
    [
        ({"start": [2.0, 0.0, 0.2]}, "the tool, which comes no nearer than 1.3"),
        ({"start": [0.6999, 0.0, 0.2]}, "singular poses .* smallest singular value"),
        ({"file": None}, "robot.file = null: must be the path of an .sdf, .urdf"),
        ({"file": "no.urdf"}, "robot.file = 'no.urdf': must be readable .No such file"),
        ({"posture": [0.0]}, r"robot.posture = \[0.0\]: must be a list of 3 finite"),
        ({"gravity": [-9.81]}, r"robot.gravity = \[-9.81\]: must be a list of 3 fin"),
        ({"tool_frame": "hand"}, "robot.tool_frame = 'hand': must be a frame of the"),
        ({"tool_frame": "base"}, "robot.tool_frame = 'base': must be tool, because"),
    ],
)
def test_bad_fields_get_one_clear_line(fields, message):
    with pytest.raises(ScenarioError, match=message) as error:
        replace(arm(), **fields).Check("robot")
    assert "\n" not in str(error.value)


# The scenario.


def test_a_recording_is_read_where_the_model_is_not(tmp_path):
    model = tmp_path / "gone.urdf"
    model.write_text(URDF.read_text())
    scenario = LoadScenario(TASK, {"duration": 0.05, "robot.file": str(model)})
    simulate(scenario).Save(tmp_path / "run.npz")
    model.unlink()
    with pytest.raises(ScenarioError, match=r"robot\.file = .* must be readable"):
        scenario.Validate()
    assert LoadRecording(tmp_path / "run.npz").scenario == scenario


def test_fewer_axes_than_joints(capsys):
    overrides = {
        "robot.start": [0.45, 0.0],
        "surgeon.velocity": [0.1, 0.0],
        "controller.network": {"lower": [0, 0], "upper": [1, 1], "count": [2, 2]},
    }
    options = [
        x for k, v in overrides.items() for x in ("--set", f"{k}={json.dumps(v)}")
    ]
    assert main(["run", TASK, *options, *SHORT, "--json", "-"]) == 0
    assert len(json.loads(capsys.readouterr().out)["final"]["position"]) == 2
    # Against a closed form: tests/study/analysis/test_linearization.py.
    assert main(["analyze", TASK, *options, *SHORT]) == 0
    assert "stable" in capsys.readouterr().out
