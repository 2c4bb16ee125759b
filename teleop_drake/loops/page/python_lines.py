"""The parts of the Python lines that make the state of a page."""

from collections.abc import Callable
from typing import Any

from pydrake.systems.framework import System

from teleop_drake.loops.engine.parameters import ScalarsIn
from teleop_drake.loops.run.run import Job

_OF_PAGE = "\n# diagram_of_this_page is the Diagram from which the page was made.\n"


def DiagramParts(source: System | Callable[[], System], job: Job) -> dict[str, Any]:
    """Returns the parts for a Diagram.

    They are `imports` and `source`, which make the Diagram; `given`, the numbers of the
    Context that are not the default ones; and the `duration`.
    """
    name = getattr(source, "__qualname__", "")
    module = getattr(source, "__module__", None)
    is_importable = name.isidentifier() and module not in (None, "__main__")
    diagram = job.diagram
    default = ScalarsIn(diagram, diagram.CreateDefaultContext())
    return {
        "imports": f"from {module} import {name}\n" if is_importable else _OF_PAGE,
        "source": f"{name}()" if is_importable else "diagram_of_this_page",
        "given": [
            f"{key!r}: {number.value!r}"
            for key, number in ScalarsIn(diagram, job.context).items()
            if key in default and number.value != default[key].value
        ],
        "duration": job.duration,
    }
