"""The torque that carries an arm's weight."""

from typing import Any

from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.kernel.convertible import Convertible, DualOf, PlantPorts


class _Compensation(PlantPorts):
    """Ports and callback for any scalar type."""

    def Declare(self: Any, T: Any) -> None:
        """Declares the ports."""
        self._state = self.DeclareVectorInputPort(
            "plant_state", self.plant.num_multibody_states()
        )
        self.DeclareVectorOutputPort(
            "gravity_torque", self.plant.num_velocities(), self._CalcTorque
        )

    def _CalcTorque(self: Any, context: Any, output: Any) -> None:
        model = self.plant
        model_context = self._plant_context
        model.SetPositionsAndVelocities(model_context, self._state.Eval(context))
        output.SetFromVector(-model.CalcGravityGeneralizedForces(model_context))


class GravityCompensation(_Compensation, Convertible):
    """Torque that would keep a model of the arm at rest.

        tau = g(q) = -(the generalized forces of gravity on the model)

    | port | name           | size    | unit                     |
    |------|----------------|---------|--------------------------|
    | in   | plant_state    | nq + nv | rad or m, and their rates|
    | out  | gravity_torque | nv      | N m or N                 |

    State: none. Direct feedthrough: yes.

    The model is what the motors' controller believes the arm to be. If it is the arm,
    the arm floats; if it has another payload, the arm is pulled by the difference.

    Attributes:
        model: As given.

    Args:
        model: A finalized plant with as many joints as the arm has.
    """

    dual = DualOf(_Compensation)

    def __init__(self, model: MultibodyPlant):
        Convertible.__init__(self)
        self.model = model
        self.Use(float, model)
