"""An arm from a user's model file: (2.6, 2.7) for any open chain.

A model of the two links of Appendix A has the equations (A.1) to (A.14), like
two_link_arm.
"""

import re
from dataclasses import field
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, ModelInstanceIndex

from teleop_drake.loops.framework.arrays import ArrayLike
from teleop_drake.loops.framework.files import ReadText
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckVector,
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
from teleop_drake.model.blocks.robots.model_joints import (
    AddMotors,
    CoupledJoints,
    LockJoints,
    PlaceBase,
)

_SUFFIXES = (".sdf", ".urdf", ".xml")


@Config
class ArmConfig(DrivenArmConfig):
    """An open chain of driven joints, its tool moved along the first n world axes.

    n is the number of entries of `start`, 1 to 3 or 6, and at most the number of
    joints. Motions of the joints that the task leaves free are not controlled unless
    `hold` is set.
    """

    kind = "arm"
    file_fields = ("file",)

    # An SDF, URDF or MJCF file (.xml) with one model. A model without a joint to the
    # world is welded to the world. Each joint needs a motor, which a URDF declares in a
    # `transmission`. In a scenario file the path is relative to that file.
    file: str = REQUIRED
    # Whether joints without a motor in the file get one, and position controllers of
    # the file become motors.
    add_motors: bool = False
    # The frame or link whose origin touches the environment.
    tool_frame: str = TOOL
    # Names of joints that are locked at their default positions. A joint that the file
    # couples with others, such as the fingers of a gripper, has to be among them.
    locked: list[str] = field(default_factory=list)
    # Pose in the world of the axes that the file calls the world's, or of the base: x,
    # y, z in m, then roll, pitch, yaw in rad. [0, 0, 0, -1.5707963267948966, 0, 0]
    # turns an arm of the x-z plane into the x-y plane. Null: none.
    base: np.ndarray | None = None

    def LoadModel(self, gravity: ArrayLike, payload: float) -> MultibodyPlant:
        """Returns the plant with a payload; see DrivenArmConfig.LoadModel."""
        if not isinstance(self.locked, list):
            Refuse("locked", self.locked, "a list of names of joints")
        text = self._ReadFile()
        base = np.zeros(6)
        if self.base is not None:
            CheckVector("base", self.base, 6, "m and rad")
            base = np.asarray(self.base, dtype=float)
        try:
            with NewPlant(gravity) as plant:
                instance = self._Parse(Parser(plant), text)
                LockJoints(plant, instance, self.locked)
                X_WB = RigidTransform(RollPitchYaw(base[3:]), base[:3])
                PlaceBase(plant, instance, X_WB)
                self._MarkTool(plant, instance)
                AddPayload(plant, payload)
                if self.add_motors:
                    AddMotors(plant, instance)
        except ScenarioError:
            raise
        except (RuntimeError, ValueError, SystemExit) as e:
            reason = " ".join(str(e).split())
            Refuse("file", self.file, f"a model of one open chain ({reason})")
        self._CheckMotors(plant)
        self._CheckInertias(plant)
        return plant

    def _CheckMotors(self, plant: MultibodyPlant) -> None:
        """Refuses a plant that is not driven by one motor for each joint."""
        nv = plant.num_velocities()
        nu = plant.num_actuators()
        motors = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
        controlled = [motor.name() for motor in motors if motor.has_controller()]
        B = plant.MakeActuationMatrix()
        if B.shape != (nv, nv) or not np.array_equal(B @ B.T, np.eye(nv)):
            Refuse(
                "file",
                self.file,
                f"an arm with one actuator for each joint, not {nu} actuators for {nv} "
                "joint velocities; add_motors: true adds those that are missing",
            )
        if controlled:
            Refuse(
                "file",
                self.file,
                f"an arm of motors without position control, unlike {controlled[0]}; "
                "add_motors: true makes them motors",
            )

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
            Refuse("file", self.file, "the path of an .sdf, .urdf or .xml file")
        text = ReadText(self.file, f"file = {Show(self.file)}")
        # Drake ignores constraints, which a continuous plant does not support.
        for constraint in ("loop_joint", "connect", "weld"):
            if re.search(rf"<(drake:)?{constraint}\b", text):
                Refuse("file", self.file, f"without constraints ({constraint})")
        free = [name for name in CoupledJoints(text) if name not in self.locked]
        if free:
            names = ", ".join(free)
            Refuse("locked", self.locked, f"with {names}, which the file couples")
        return text

    def _Parse(self, parser: Parser, text: str) -> ModelInstanceIndex:
        """Adds the model of the file to the parser's plant."""
        # Drake parses SDF fifty times faster as text, where it finds no other files.
        if self.file.endswith(".sdf") and not re.search(r"<uri\b", text):
            models = parser.AddModelsFromString(text, "sdf")
        else:
            models = parser.AddModels(self.file)
        if len(models) != 1:
            Refuse("file", self.file, f"a file of one model, not of {len(models)}")
        return models[0]

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
