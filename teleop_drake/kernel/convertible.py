"""Drake's scalar conversion for blocks in Python.

pydrake's TemplateSystem serves the same purpose. It inspects the call stack for each
class that it makes, which takes up to half a second when a program starts.
"""

from typing import Any, ClassVar

from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem, LeafSystem_, SystemScalarConverter


def DualOf(ports: Any) -> Any:
    """Returns the class of the blocks of AutoDiffXd with the ports of another block.

    Args:
        ports: Base class of both blocks: ports and callbacks for any scalar type. Its
            Mirror() declares the ports of the block that is converted.
    """

    class Dual(ports, LeafSystem_[AutoDiffXd]):
        def __init__(self, other: Any):
            LeafSystem_[AutoDiffXd].__init__(self)
            self.Mirror(other)

    return Dual


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


class Convertible(LeafSystem):
    """A block that Drake converts to AutoDiffXd, by itself or in a diagram.

    Attributes:
        dual: Makes a block of AutoDiffXd that computes what this block computes.
    """

    dual: ClassVar[Any]

    def __init__(self) -> None:
        LeafSystem.__init__(self, converter=_CONVERTER)

    def ToAutoDiffXd(self) -> Any:
        """Returns the block of AutoDiffXd as an instance of its Python class."""
        dual = _Convert(self)
        dual._HandlePostConstructionScalarConversion[float](self)
        return dual

    ToAutoDiffXdMaybe = ToAutoDiffXd


def _Convert(block: Convertible) -> Any:
    dual = type(block).dual(block)
    dual.set_name(block.get_name())
    return dual


_CONVERTER = SystemScalarConverter()
_CONVERTER._AddConstructor[AutoDiffXd, float](_Convert)
