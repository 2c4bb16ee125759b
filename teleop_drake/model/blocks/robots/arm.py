"""An arm from a user's model file: (2.6, 2.7) for any open chain.

A model of the two links of Appendix A has the equations (A.1) to (A.14), like
two_link_arm.
"""

import re
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, ModelInstanceIndex

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.files import ReadText
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    Config,
    IsGiven,
    Refuse,
    ScenarioError,
    Show,
)
from teleop_drake.model.blocks.robots.base import NewPlant
from teleop_drake.model.blocks.robots.driven_arm import AddPayload, DrivenArmConfig
from teleop_drake.model.blocks.robots.inertias import LinkWithoutInertia
from teleop_drake.model.blocks.robots.inverse_kinematics import TOOL

_SUFFIXES = (".sdf", ".urdf")


@Config
class ArmConfig(DrivenArmConfig):
    """An open chain of driven joints, its tool moved along the first n world axes.

    n is the number of entries of `start`, 1 to 3 or 6, and at most the number of
    joints. Motions of the joints that the task leaves free are not controlled unless
    `hold` is set.
    """

    kind = "arm"
    file_fields = ("file",)

    # An SDF or URDF file with one model. A model without a joint to the world is welded
    # to the world's origin. Each joint needs a motor, which a URDF declares in a
    # `transmission`. In a scenario file the path is relative to that file.
    file: str = REQUIRED
    # Whether joints without a motor in the file get one.
    add_motors: bool = False
    # The frame or link whose origin touches the environment.
    tool_frame: str = TOOL

    def LoadModel(self, gravity: ArrayLike, payload: float) -> MultibodyPlant:
        """Returns the plant with a payload; see DrivenArmConfig.LoadModel."""
        text = self._ReadFile()
        try:
            with NewPlant(gravity) as plant:
                (instance,) = self._Parse(Parser(plant), text)
                _WeldBase(plant, instance)
                self._MarkTool(plant, instance)
                AddPayload(plant, payload)
                if self.add_motors:
                    _AddMotors(plant, instance)
        except ScenarioError:
            raise
        except (RuntimeError, ValueError, SystemExit) as e:
            reason = " ".join(str(e).split())
            Refuse("file", self.file, f"a model of one open chain ({reason})")
        nv = plant.num_velocities()
        nu = plant.num_actuators()
        B = plant.MakeActuationMatrix()
        if B.shape != (nv, nv) or not np.array_equal(B @ B.T, np.eye(nv)):
            Refuse(
                "file",
                self.file,
                f"an arm with one actuator for each joint, not {nu} actuators for {nv} "
                "joint velocities; add_motors: true adds those that are missing",
            )
        self._CheckInertias(plant)
        return plant

    def _CheckInertias(self, plant: MultibodyPlant) -> None:
        """Refuses a link that a joint moves although it has no inertia."""
        context = plant.CreateDefaultContext()
        # A pose in which no two axes are in line.
        plant.SetPositions(context, 0.3 + 0.2 * np.arange(plant.num_positions()))
        link = LinkWithoutInertia(plant, context)
        if link:
            allowed = f"a model with mass and inertia (`inertial`) of the link {link!r}"
            Refuse("file", self.file, f"{allowed}, which a joint moves")

    def _ReadFile(self) -> str:
        """Returns the text of the model file; refuses what Drake would ignore in it."""
        if not IsGiven(self.file) or Path(self.file).suffix not in _SUFFIXES:
            Refuse("file", self.file, "the path of an .sdf or .urdf file")
        text = ReadText(self.file, f"file = {Show(self.file)}")
        # Drake ignores these constraints, which a continuous plant does not support.
        for constraint in ("mimic", "loop_joint"):
            if re.search(rf"<(drake:)?{constraint}\b", text):
                Refuse("file", self.file, f"without constraints ({constraint})")
        return text

    def _Parse(self, parser: Parser, text: str) -> list[ModelInstanceIndex]:
        """Adds the models of the file to the parser's plant."""
        # Drake parses SDF fifty times faster as text, where it finds no other files.
        if self.file.endswith(".sdf") and not re.search(r"<uri\b", text):
            return parser.AddModelsFromString(text, "sdf")
        return parser.AddModels(self.file)

    def _MarkTool(self, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        """Adds a frame TOOL at the tool frame's origin, unless that is its name."""
        name = self.tool_frame
        if not plant.HasFrameNamed(name, instance):
            bodies = map(plant.get_body, plant.GetBodyIndices(instance))
            known = ", ".join(body.name() for body in bodies)
            Refuse("tool_frame", name, f"a frame of the model, such as {known}")
        if name == TOOL:
            return
        if plant.HasFrameNamed(TOOL, instance):
            Refuse(
                "tool_frame", name, f"{TOOL}, because the model has a frame so named"
            )
        frame = plant.GetFrameByName(name, instance)
        plant.AddFrame(FixedOffsetFrame(TOOL, frame, RigidTransform(), instance))


def _WeldBase(plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
    """Welds a model to the world's origin unless a joint connects it to the world."""
    joints = [plant.get_joint(i) for i in plant.GetJointIndices(instance)]
    if any(joint.parent_body().index() == 0 for joint in joints):
        return
    children = {joint.child_body().index() for joint in joints}
    bases = [i for i in plant.GetBodyIndices(instance) if i not in children]
    if len(bases) == 1:
        plant.WeldFrames(plant.world_frame(), plant.get_body(bases[0]).body_frame())


def _AddMotors(plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
    """Adds an actuator to each joint of one degree of freedom that has none."""
    driven = {
        int(plant.get_joint_actuator(i).joint().index())
        for i in plant.GetJointActuatorIndices()
    }
    for i in plant.GetJointIndices(instance):
        joint = plant.get_joint(i)
        if joint.num_velocities() == 1 and int(i) not in driven:
            plant.AddJointActuator(f"{joint.name()}_motor", joint)
