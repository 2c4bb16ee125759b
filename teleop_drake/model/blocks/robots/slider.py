"""The robot of the thesis with one axis."""

from pydrake.multibody.plant import MultibodyPlant

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.validation import Config, Number
from teleop_drake.model.blocks.robots.base import (
    LoadModel,
    PlantRobotConfig,
    PointOf,
    ReadModel,
)


@Config
class SliderConfig(PlantRobotConfig):
    """A carriage on a rail along x (thesis eq. 2.12)."""

    kind = "slider"

    # Mass, kg, > 0. Null: that of the model file.
    mass: float | None = Number(None, "kg", above=0)
    # Viscous damping of the rail, N s/m, >= 0. Null: that of the model file.
    damping: float | None = Number(None, "N s/m", minimum=0)

    def LoadPlant(self, gravity: ArrayLike | None = None) -> MultibodyPlant:
        """Returns the plant; see PlantRobotConfig.LoadPlant."""
        self.CheckNumbers()
        model = ReadModel(self.kind)
        # Overrides change the model itself, and so every Context of the plant.
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
        """Returns the position of the carriage, which is that of the tool."""
        return PointOf(p_WT, 1)
