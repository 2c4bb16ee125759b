"""The scene: what stands where."""

from pathlib import Path

import numpy as np
import pytest
from own_kinds import PuckConfig
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from teleop_drake.environments import Surface
from teleop_drake.figures.scene import AddScene, Scene
from teleop_drake.figures.scene.actor import NUM_BEADS
from teleop_drake.figures.scene.stage import SCENE
from teleop_drake.figures.scene.visuals import RobotVisuals
from teleop_drake.robots import ArmConfig
from teleop_drake.scenario import LoadScenario
from teleop_drake.teleoperator import AddTeleoperator

DIAGRAMS = Path(__file__).parents[3] / "diagrams"


class Notes:
    """A pen that notes down what it is told, by path."""

    def __init__(self):
        self.poses, self.positions, self.scales, self.shown = {}, {}, {}, {}

    def Place(self, path, X):
        self.poses[path] = X

    def Move(self, path, p):
        self.positions[path] = np.array(p)

    def Scale(self, path, factors):
        self.scales[path] = factors

    def Show(self, path, is_shown):
        self.shown[path] = is_shown


def MakeScene(meshcat, scenario, surfaces, signals):
    """Returns a scene, its notes and what draws an instant in it."""
    sizes = {name: len(value) for name, value in signals.items()}
    scene = Scene(meshcat, scenario, surfaces=surfaces, sizes=sizes, period=1.0)
    scene._pen = notes = Notes()
    context = scene.CreateDefaultContext()

    def Draw(time, signals):
        context.SetTime(time)
        for name, value in signals.items():
            scene.GetInputPort(name).FixValue(context, value)
        scene._Publish(context)

    return scene, notes, Draw


@pytest.fixture(scope="module")
def meshcat():
    return Meshcat(0)


@pytest.mark.parametrize("name", ["one_dof", "two_dof_combined"])
def test_simulated_plants_tell_no_shapes(name):
    robot = LoadScenario(name).robot
    assert RobotVisuals(robot).parts
    assert not robot.LoadPlant().geometry_source_is_registered()


def test_ghost_reaches_where_it_is_felt():
    robot = LoadScenario("two_dof_combined").robot
    visuals = RobotVisuals(robot)
    q = visuals.Pose([0.9, 0.1], visuals.start_q)
    np.testing.assert_allclose(visuals.Tool(q), [0.9, 0.1, 0.0], atol=1e-9)
    # It is the pose near the robot's own, not the one with the elbow on the other side.
    np.testing.assert_allclose(q, robot.JointPositions([0.9, 0.1]), atol=1e-6)
    # Out of reach it comes near.
    far = visuals.Tool(visuals.Pose([1.6, 0.0], visuals.start_q))
    np.testing.assert_allclose(far, [1.5, 0.0, 0.0], atol=0.01)


def test_a_model_file_has_its_own_looks(tmp_path):
    """Shapes of any SDF or URDF; links without any are sticks."""
    text = (DIAGRAMS / "own_arm.urdf").read_text(encoding="utf-8")
    visual = """<visual><origin xyz="0.1 0 0"/><geometry><sphere radius="0.02"/>
      </geometry><material name="red"><color rgba="1 0 0 0.5"/></material></visual>"""
    file = tmp_path / "arm.urdf"
    file.write_text(
        text.replace('<link name="forearm">', f'<link name="forearm">{visual}')
    )
    start, posture = [0.45, 0.0, 0.2], np.array([0.0, -0.7, 1.5])
    (part,) = RobotVisuals(
        ArmConfig(file=str(file), start=start, posture=posture)
    ).parts
    assert part.body == "forearm" and part.shape.radius() == 0.02
    assert part.rgba.r() == 1.0 and part.rgba.a() == 0.5
    np.testing.assert_allclose(part.X_BG.translation(), [0.1, 0.0, 0.0])
    file.write_text(text)
    sticks = RobotVisuals(ArmConfig(file=str(file), start=start, posture=posture)).parts
    assert [x.body for x in sticks] == ["column", "upper_arm", "forearm"]
    lengths = [x.shape.length() for x in sticks]
    np.testing.assert_allclose(lengths, [0.2, 0.4, 0.3])


def test_a_robot_that_is_no_plant_is_a_point(meshcat):
    """And a task along another direction is seen from its side."""
    scenario = LoadScenario("one_dof")
    scenario.robot = PuckConfig(start=np.array([0.1, 0.2, 0.3]))
    wall = Surface("contact", [0.0, 0.0, 0.1], [0.0, 0.0, -1.0])
    signals = {"tool_position": [0.1, 0.2, 0.25]}
    scene, notes, Draw = MakeScene(meshcat, scenario, (wall,), signals)
    Draw(0.0, signals)
    tip = notes.positions[f"{SCENE}/run/robot/tip"]
    np.testing.assert_allclose(tip, [0.1, 0.2, 0.25])
    # Forward, to the right in the picture, is into the wall; above is across.
    X_SW = scene._actor._stage.X_SW.rotation().matrix()
    np.testing.assert_allclose(X_SW @ [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], atol=1e-12)
    assert not scene._actor._visuals.parts


def test_the_picture_is_of_the_delay(meshcat):
    """The tool moves at 0.1 m/s and is felt 0.2 s later."""
    scenario = LoadScenario("two_dof_combined", {"return_channel.delay": 0.2})
    surfaces = scenario.Surfaces()
    Draw = None
    for t in [1.0, *np.linspace(0.0, 1.0, 101)]:  # What is earlier begins anew.
        tool, felt = ([0.85 + 0.1 * max(x, 0.0), 0.0] for x in (t, t - 0.2))
        signals = {
            "tool_position": tool,
            "return_packet_received": [*felt, 0.1, 0.0],
            "forward_packet_sent": [0.4, 0.0, 0.05, 0.0],
            "environment_force": [0.2, 0.0],
        }
        if Draw is None:
            _, notes, Draw = MakeScene(meshcat, scenario, surfaces, signals)
        Draw(t, signals)
    run, x = f"{SCENE}/run", {k: p[0] for k, p in notes.positions.items()}
    assert x[f"{run}/robot/tip"] == pytest.approx(0.95)
    assert x[f"{run}/hand"] == pytest.approx(0.93)
    assert x[f"{run}/command"] == pytest.approx(0.85 + 0.05)
    # The beads lead from the one to the other, as packets carry what was.
    beads = [x[f"{run}/beads/{i}"] for i in range(NUM_BEADS)]
    np.testing.assert_allclose(np.diff(beads), -0.02 / (NUM_BEADS + 1), atol=1e-9)
    heights = [notes.positions[f"{run}/beads/{i}"][2] for i in range(NUM_BEADS)]
    assert 0 < heights[0] < heights[-1] < notes.positions[f"{run}/hand"][2]
    # The tissue pushes back; the operator's force is the larger one, by its factor.
    z_axes = {k: X.rotation().matrix()[:, 2] for k, X in notes.poses.items()}
    np.testing.assert_allclose(z_axes[f"{run}/tool_force"], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(z_axes[f"{run}/hand_force"], [1, 0, 0], atol=1e-12)
    shafts = [notes.scales[f"{run}/{x}_force/shaft"][2] for x in ("tool", "hand")]
    assert 0 < shafts[0] < shafts[1]


def test_every_simulation_is_seen(meshcat):
    """AddScene draws what the loop's systems put out."""
    scenario = LoadScenario("one_dof")
    builder = DiagramBuilder()
    AddTeleoperator(builder, scenario)
    scene = AddScene(builder, scenario, meshcat)
    scene._pen = notes = Notes()
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    assert notes.positions[f"{SCENE}/run/hand"][0] == 0.0
    for part in ("robot/carriage", "ghost/carriage", "hand", "command", "beads/0"):
        assert meshcat.HasPath(f"{SCENE}/run/{part}")
    for surface in ("tissue", "puncture", "contact"):
        assert meshcat.HasPath(f"{SCENE}/environment/{surface}")


def test_a_loop_without_a_robot_is_refused(meshcat):
    with pytest.raises(RuntimeError, match="tool_position"):
        AddScene(DiagramBuilder(), LoadScenario("one_dof"), meshcat)
