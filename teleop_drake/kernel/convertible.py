"""Drake's scalar conversion for blocks in Python.

pydrake's TemplateSystem serves the same purpose. It inspects the call stack for each
class that it makes, which takes up to half a second when a program starts.
"""

from typing import Any, ClassVar

from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem, SystemScalarConverter


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
