"""The scene: what stands where, and when."""

from collections import defaultdict
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from numpy.testing import assert_allclose
from own_kinds import PuckConfig
from scene_recordings import RETURN_DELAY, SPEED, MakeRecording

from teleop_drake.model.blocks.environments import Surface
from teleop_drake.model.blocks.robots import ArmConfig
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.figures.scene import scene
from teleop_drake.study.figures.scene.scene import FRAMES_PER_SECOND, AnimateRuns
from teleop_drake.study.figures.scene.visuals import RobotVisuals


def Drawn(monkeypatch, *recordings):
    """Returns the stage, and shapes, poses and scales by their paths."""
    meshcat = Mock()
    animation = Mock()
    monkeypatch.setattr(scene, "MeshcatAnimation", lambda _: animation)
    stage = AnimateRuns(dict(enumerate(recordings)), meshcat)
    meshcat.SetAnimation.assert_called_once_with(animation)
    shapes = {x.args[0]: x.args[1] for x in meshcat.SetObject.call_args_list}
    poses = {x.args[0]: x.args[1] for x in meshcat.SetTransform.call_args_list}
    scales = defaultdict(list)
    for k, path, X in (x.args for x in animation.SetTransform.call_args_list):
        poses.setdefault(path, []).append(X)
        assert len(poses[path]) == k + 1
    for _, path, _, factors in (x.args for x in animation.SetProperty.call_args_list):
        scales[path].append(factors)
    return stage, shapes, poses, scales


def test_ghost_reaches_where_it_is_felt():
    robot = LoadScenario("two_dof_combined").robot
    visuals = RobotVisuals(robot)
    # The plant that is simulated tells no shapes.
    assert visuals.parts and not robot.LoadPlant().geometry_source_is_registered()
    q = visuals.Pose([0.9, 0.1], visuals.start_q)
    assert_allclose(visuals.Tool(q), [0.9, 0.1, 0.0], atol=1e-9)
    # It is the pose near the robot's own, not the one with the elbow on the other side.
    assert_allclose(q, robot.JointPositions([0.9, 0.1]), atol=1e-6)
    # Out of reach it comes near.
    far = visuals.Tool(visuals.Pose([1.6, 0.0], visuals.start_q))
    assert_allclose(far, [1.5, 0.0, 0.0], atol=0.01)


def test_a_model_file_has_its_own_looks(tmp_path):
    """Shapes of any SDF or URDF; links without any are sticks."""
    own_arm = Path(__file__).parents[4] / "diagrams/own_arm.urdf"
    text = own_arm.read_text(encoding="utf-8")
    visual = """<link name="forearm"><visual><origin xyz="0.1 0 0"/><geometry>
      <sphere radius="0.02"/></geometry><material name="red"><color rgba="1 0 0 0.5"/>
      </material></visual>"""
    file = tmp_path / "arm.urdf"
    start = [0.45, 0.0, 0.2]
    robot = ArmConfig(file=str(file), start=start, posture=np.array([0.0, -0.7, 1.5]))
    file.write_text(text.replace('<link name="forearm">', visual))
    (part,) = RobotVisuals(robot).parts
    assert part.body == "forearm" and part.shape.radius() == 0.02
    assert part.rgba.r() == 1.0 and part.rgba.a() == 0.5
    assert_allclose(part.X_BG.translation(), [0.1, 0.0, 0.0])
    file.write_text(text)
    sticks = RobotVisuals(robot).parts
    assert [x.body for x in sticks] == ["column", "upper_arm", "forearm"]
    lengths = [x.shape.length() for x in sticks]
    assert_allclose(lengths, [0.2, 0.4, 0.3])


def test_a_robot_that_is_no_plant_is_a_point(monkeypatch):
    """And a task along another direction is seen from its side."""
    recording = MakeRecording()
    recording.scenario.robot = PuckConfig(start=np.array([0.1, 0.2, 0.3]))
    recording.surfaces = (Surface("contact", [0.0, 0.0, 0.1], [0.0, 0.0, -1.0]),)
    tool = np.linspace([0.1, 0.2, 0.3], [0.1, 0.2, 0.1], 101)
    recording.signals = {"tool_position": tool, "environment_force": 0 * tool}
    stage, shapes, poses, _ = Drawn(monkeypatch, recording)
    assert {x.split("/")[3] for x in shapes} == {"robot", "environment"}
    assert {x.split("/")[4] for x in shapes if "robot" in x} == {"tip", "force"}
    middle = poses["/teleop/run_0/robot/tip"][FRAMES_PER_SECOND].translation()
    assert_allclose(middle, [0.1, 0.2, 0.2])
    # Forward, to the right in the picture, is into the wall; above is across.
    z_S = stage.X_WS.rotation().matrix().T @ [0.0, 0.0, -1.0]
    assert_allclose(z_S, [1.0, 0.0, 0.0], atol=1e-12)
    # The wall is a plate, with its face where the tool ends.
    wall = "/teleop/run_0/environment/contact"
    X = poses[wall]
    box = shapes[wall]
    assert X.translation()[2] + box.width() / 2 == pytest.approx(0.1)


@pytest.mark.parametrize("names", [(), ("felt_position", "force_command")])
def test_the_ghost_is_late(names, monkeypatch):
    """At 1 mm/s, felt 0.2 s later, whatever the signals of the architecture are."""
    recording = MakeRecording()
    packets = [recording["return_packet_received"], recording["forward_packet_sent"]]
    if names:
        del recording.signals["return_packet_received"]
        recording.signals |= zip(names, [x[:, :1] for x in packets], strict=True)
    stage, _, poses, scales = Drawn(monkeypatch, recording, recording)
    t = np.arange(2 * FRAMES_PER_SECOND + 1) / FRAMES_PER_SECOND
    # The robot is pushed back; the operator's force is half as large.
    for name, delay, force in (("robot", 0.0, -1.0), ("ghost", RETURN_DELAY, 0.5)):
        path = f"/teleop/run_1/{name}"
        for part in ("tip", "carriage"):
            x = np.array([X.translation()[0] for X in poses[f"{path}/{part}"]])
            expected = SPEED * np.maximum(t - delay, 0.0)
            assert_allclose(x - x[0], expected, atol=1e-6)
        scale = np.array(scales[f"{path}/force"])[:, 2]
        arrow = poses[f"{path}/force"][-1].rotation().col(2) * scale[-1]
        assert_allclose(arrow, [force, 0.0, 0.0], atol=1e-12)
        assert scale[0] < 1e-5
    # The ghost is above its robot, the second run below the first.
    height = stage.ghost_height * stage.width
    assert poses["/teleop/run_1/ghost"].translation()[2] == height
    assert poses["/teleop/run_1"].translation()[2] < -1.2 * height
    assert poses["/teleop/run_0"].translation()[2] == 0.0


def test_slabs_begin_at_surfaces(monkeypatch):
    """The tissue begins anywhere, yields at 7.5 mm, and the bone begins at 15 mm."""
    stage, shapes, poses, _ = Drawn(monkeypatch, MakeRecording())
    paths = [
        f"/teleop/run_0/environment/{x}" for x in ("tissue", "puncture", "contact")
    ]
    x = np.array([poses[path].translation()[0] for path in paths])
    half = np.array([shapes[path].width() / 2 for path in paths])
    low, high = stage.X_WS.translation()[0] + np.array([-0.5, 0.5]) * stage.width
    assert_allclose(x - half, [low, 0.0075, 0.015], atol=1e-12)
    assert_allclose(x + half, [0.0075, 0.015, high], atol=1e-12)
    assert low < 0.0


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("name", "last", "seen"),
    [("two_dof_puncture", 1.3, (1.3, 1.6)), ("two_dof_combined", 1.8, (1.1, 1.4))],
)
def test_a_task_is_seen_to_its_end(name, last, seen, monkeypatch):
    """Behind the puncture as far as the tool goes, but not much deeper than bone."""
    recording = MakeRecording(name)
    recording.signals["tool_position"] = np.linspace([0.85, 0.0], [last, 0.0], 101)
    stage, *_ = Drawn(monkeypatch, recording)
    x = stage.X_WS.translation()[0]
    half = stage.width / 2
    assert x - half < 0.85 and seen[0] < x + half < seen[1]
