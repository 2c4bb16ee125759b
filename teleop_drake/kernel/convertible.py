"""Drake's scalar conversion for blocks in Python.

pydrake's TemplateSystem does the same, but looks through the stack for each class that
it makes, which takes up to half a second when a program begins.
"""

from abc import abstractmethod
from typing import Any

from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem, SystemScalarConverter


class Convertible(LeafSystem):
    """A block that Drake converts to AutoDiffXd, by itself or in a diagram."""

    def __init__(self) -> None:
        LeafSystem.__init__(self, converter=_CONVERTER)

    @abstractmethod
    def ToDual(self) -> Any:
        """Returns a new block of AutoDiffXd that computes the same."""

    def ToAutoDiffXd(self) -> Any:
        """Returns the block of AutoDiffXd as what it is in Python."""
        dual = _Convert(self)
        dual._HandlePostConstructionScalarConversion[float](self)
        return dual

    ToAutoDiffXdMaybe = ToAutoDiffXd


def _Convert(block: Convertible) -> Any:
    dual = block.ToDual()
    dual.set_name(block.get_name())
    return dual


_CONVERTER = SystemScalarConverter()
_CONVERTER._AddConstructor[AutoDiffXd, float](_Convert)
