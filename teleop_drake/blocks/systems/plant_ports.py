"""Base of the blocks that ask a MultibodyPlant, with Drake's scalar conversion."""

from typing import Any

from pydrake.autodiffutils import AutoDiffXd


class PlantPorts:
    """Ports and callbacks of a block that asks a plant, for any scalar type.

    A subclass declares its ports in Declare(), which takes the scalar type and what was
    given to Use(). It keeps indices of bodies and frames, and looks these up each time:
    to keep one would keep the plant, which keeps the block, where Python's garbage
    collector does not see it.

    Attributes:
        plant: The plant.
        given: What else the block was given, by name.
    """

    def Use(self: Any, T: Any, plant: Any, **given: Any) -> None:
        """Declares the ports of a block of a scalar type that asks a plant.

        Args:
            T: float or AutoDiffXd.
            plant: A finalized plant of this type.
            given: What else Declare() takes.
        """
        self.plant = plant
        self.given = given
        # Working memory only: every calculation sets its state before it is read.
        self._plant_context = plant.CreateDefaultContext()
        self.Declare(T, **given)

    def Mirror(self, other: Any) -> None:
        """Declares the ports of a block of float, with its plant as AutoDiffXd."""
        self.Use(AutoDiffXd, other.plant.ToAutoDiffXd(), **other.given)
