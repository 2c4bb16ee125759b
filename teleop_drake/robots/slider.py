"""The thesis's robot on one axis."""

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.robots.base import Array, CheckStart, PlantRobotConfig
from teleop_drake.robots.model_file import LoadModel, ReadModel
from teleop_drake.validation import ScenarioError, Within


@dataclass(kw_only=True, eq=False)
class SliderConfig(PlantRobotConfig):
    """A carriage on a rail along x (thesis eq. 2.12)."""

    kind = "slider"

    # Mass, kg, > 0. Null keeps the model's own.
    mass: float | None = None
    # Viscous damping of the rail, N s/m, >= 0. Null keeps the model's own.
    damping: float | None = None

    def Check(self, path: str) -> None:
        """Checks every field.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        with Within(path):
            self._CheckOverrides()
            self.JointPositions(self.start)

    def _CheckOverrides(self) -> None:
        mass, damping = self.mass, self.damping
        if mass is not None and not 0 < mass < math.inf:
            raise ScenarioError(f"mass: {mass!r} must be finite and > 0 kg")
        if damping is not None and not 0 <= damping < math.inf:
            raise ScenarioError(f"damping: {damping!r} must be finite and >= 0 N s/m")

    def LoadPlant(self, gravity: ArrayLike | None = None) -> MultibodyPlant:
        """Returns the plant; see PlantRobotConfig.LoadPlant.

        Raises:
            ScenarioError: If a parameter is not allowed.
        """
        self._CheckOverrides()
        model = ReadModel(self.kind)
        # Overrides go into the model's text, and so into every context of the plant.
        for value, path in (
            (self.mass, ".//link[@name='carriage']/inertial/mass"),
            (self.damping, ".//joint[@name='rail']/axis/dynamics/damping"),
        ):
            if value is not None:
                element = model.find(path)
                assert element is not None
                element.text = repr(float(value))
        return LoadModel(model, gravity)

    def JointPositions(self, p_WT: ArrayLike) -> Array:
        """Returns the position of the carriage, which is the tool's.

        Raises:
            ScenarioError: If it is not a finite number.
        """
        return CheckStart(self, 1, p_WT)
