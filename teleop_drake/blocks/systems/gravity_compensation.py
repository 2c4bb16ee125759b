"""The torque that carries an arm's weight."""

from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.blocks.systems.plant_tree import ReadPlantTree
from teleop_drake.kernel import FixedBlock, Kernel
from teleop_drake.laws.task_space import gravity_torque


class GravityCompensation(FixedBlock):
    """Torque that would keep a model of the arm at rest.

        tau = g(q) = -(the generalized forces of gravity on the model)

    | port | name           | size    | unit                     |
    |------|----------------|---------|--------------------------|
    | in   | plant_state    | nq + nv | rad or m, and their rates|
    | out  | gravity_torque | nv      | N m or N                 |

    State: none. Direct feedthrough: yes.

    The model is what the motors' controller believes the arm to be. If it is the arm,
    the arm floats; if it has another payload, the arm is pulled by the difference.

    Args:
        model: A finalized plant of revolute and prismatic joints, as many as the arm
            has.
    """

    is_compiled = True

    def __init__(self, model: MultibodyPlant):
        read = ReadPlantTree(model, model.CreateDefaultContext())
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters={"tree": read.tree},
                outputs={"gravity_torque": (gravity_torque, "tree", "plant_state")},
            ),
            inputs={"plant_state": model.num_multibody_states()},
            outputs={"gravity_torque": model.num_velocities()},
        )
