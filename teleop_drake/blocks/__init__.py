"""The blocks of a teleoperation loop, and the classes that configure them.

    from teleop_drake.blocks import DirectForce, TransportDelay

Each name is imported on its first use; `__init__.pyi` has the modules.
"""

from teleop_drake.loops import Importer, ReadStub

_PLACES = ReadStub(__file__)

__all__ = sorted(_PLACES)
__getattr__ = Importer(__name__, _PLACES)


def __dir__() -> list[str]:
    """Returns all names, including those that are not imported yet."""
    return list(__all__)
