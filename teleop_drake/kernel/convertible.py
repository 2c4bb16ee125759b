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
