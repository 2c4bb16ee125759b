"""Compensation of an arm's weight by joint torques."""

from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.loops.engine.plant_tree import ReadPlantTree
from teleop_drake.loops.kernel import FixedBlock, Kernel
from teleop_drake.model.laws.task_space import gravity_torque


class GravityCompensation(FixedBlock):
    """Torque that balances gravity on a model of the arm.

        tau = g(q) = -(the generalized forces of gravity on the model)

    | port | name           | size    | unit                     |
    |------|----------------|---------|--------------------------|
    | in   | plant_state    | nq + nv | rad or m, and their rates|
    | out  | gravity_torque | nv      | N m or N                 |

    State: none. Direct feedthrough: yes.

    The model is that of the motors' controller. If it equals the arm, the arm floats.
    If its payload differs from that of the arm, the difference of the weights pulls at
    the arm.

    Args:
        model: A finalized plant with the joints of the arm, revolute or prismatic.
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
