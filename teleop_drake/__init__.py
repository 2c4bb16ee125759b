"""Haptic teleoperation under communication delay as Drake systems diagrams.

The model of P. P. Sarda, "Control of a Teleoperating Robotic Arm Subject to Time
Delays", MS thesis, The University of Texas at Arlington, 2012.

The most used names are exported here, and so are all names of teleop_drake.blocks:
`from teleop_drake import TransportDelay, simulate`. Each is imported on first use, so
that importing the package itself is cheap.
"""

from teleop_drake import blocks
from teleop_drake.loops import Importer, ReadStub
from teleop_drake.moved import FindMoved

__version__ = "0.1.0"

# The module of each name. The stub imports the blocks by a star.
_PLACES = ReadStub(__file__) | dict.fromkeys(blocks.__all__, blocks.__name__)
del _PLACES["*"]

# RecordingHtml is for recordings, which are on a lower floor.
__all__ = sorted(_PLACES.keys() - {"RecordingHtml"})
__getattr__ = Importer(__name__, _PLACES)

FindMoved()


def __dir__() -> list[str]:
    """Returns the names of the package, including those not imported yet."""
    return sorted({*globals(), *__all__} - {"FindMoved", "Importer", "ReadStub"})
