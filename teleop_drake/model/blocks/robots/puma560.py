"""The Unimation Puma 560."""

import math
from dataclasses import field
from functools import partial

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import Config, Number
from teleop_drake.model.blocks.robots.base import ModelText, NewPlant
from teleop_drake.model.blocks.robots.driven_arm import AddPayload, DrivenArmConfig
from teleop_drake.model.blocks.robots.robot_diagram import JointDrive
from teleop_drake.model.blocks.systems.joint_friction import JointFriction

# Coulomb friction at the motors while they turn forward and backward, N m: Corke and
# Armstrong-Helouvry 1994, in the numbers of Corke's Robotics Toolbox. At the joints it
# is the gear ratio times as much: 24.7, 13.6, 7.1, 0.85, 0.67, 0.30 N m forward.
# Armstrong, Khatib and Burdick 1986 found break-away torques of 6.3, 5.5, 2.6, 1.3, 1.0
# and 1.2 N m at the joints of another arm. Arms of one type differ as much.
_COULOMB_FORWARD = (0.395, 0.126, 0.132, 11.2e-3, 9.26e-3, 3.96e-3)
_COULOMB_BACKWARD = (0.435, 0.071, 0.105, 16.9e-3, 14.5e-3, 10.5e-3)

_STANDARD_GRAVITY = 9.80665

# Smallest friction_speed; with less, the solver takes steps of microseconds.
_LEAST_SPEED = 1e-4


# The pose `qn` of Corke's Robotics Toolbox; the needle points along x.
_NOMINAL = (0.0, math.pi / 4, -math.pi, 0.0, math.pi / 4, 0.0)


@Config
class Puma560Config(DrivenArmConfig):
    """The robot of the thesis's future work (section 6.3), with weight and friction.

    It has six joints with gears. models/puma560.sdf names the source of every number.
    The robot stands at the world's origin, z upward. The needle's tip is the tool.
    """

    kind = "puma560"
    default_gravity = (0, 0, -_STANDARD_GRAVITY)

    # Joint positions near which those at the start are searched, rad, 6 entries.
    posture: np.ndarray | None = field(default_factory=partial(np.array, _NOMINAL))
    # Acceleration of gravity along the world's axes, m/s^2, 3 entries. Null: standard
    # gravity along -z.
    gravity: np.ndarray | None = None
    gravity_compensation: bool = True
    hold: str = "orientation"
    # Share of the published friction, viscous and Coulomb, that acts, >= 0. If it is
    # less than 1, the motors compensate the rest, which is not counted in their torque.
    friction: float = Number(1.0, minimum=0)
    # Joint speed within which the Coulomb friction changes sign, rad/s, >= 1e-4.
    # Assumed.
    friction_speed: float = Number(0.02, "rad/s", minimum=_LEAST_SPEED)

    def LoadModel(self, gravity: ArrayLike, payload: float) -> MultibodyPlant:
        """Returns the plant with a payload; see DrivenArmConfig.LoadModel."""
        with NewPlant(gravity) as plant:
            Parser(plant).AddModelsFromString(ModelText(self.kind), "sdf")
            for index in plant.GetJointIndices():
                joint = plant.get_mutable_joint(index)
                if joint.num_velocities():
                    joint.set_default_damping(self.friction * joint.default_damping())
            AddPayload(plant, payload)
        return plant

    def MakeDrive(
        self, plant: MultibodyPlant, q: Array, gravity: ArrayLike | None
    ) -> JointDrive:
        """Returns the systems that drive the joints; see PlantRobotConfig.MakeDrive."""
        drive = super().MakeDrive(plant, q, gravity)
        if self.friction == 0:
            return drive
        motors = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
        ratios = np.array([abs(motor.default_gear_ratio()) for motor in motors])
        drive.friction = JointFriction(
            forward=self.friction * ratios * _COULOMB_FORWARD,
            backward=self.friction * ratios * _COULOMB_BACKWARD,
            speed=self.friction_speed,
        )
        return drive
