"""The parts of the Python lines that make the state of a page."""

import os
from collections.abc import Callable
from typing import Any

from pydrake.systems.framework import System

from teleop_drake.parameters import ScalarsIn
from teleop_drake.scenario.overrides import Overrides, ParseOverrides
from teleop_drake.simulation.run import Job

_OF_PAGE = "\n# diagram_of_this_page is the Diagram from which the page was made.\n"


def ScenarioParts(source: Any, overrides: Overrides) -> dict[str, Any]:
    """Returns the parts for a scenario, which the page's script joins.

    They are `source`, an expression for the scenario's name or file, and `given`, the
    overrides as items of a dictionary.
    """
    is_named = isinstance(source, str | os.PathLike)
    return {
        "source": repr(os.fspath(source)) if is_named else "scenario_of_this_page",
        "given": [f"{path!r}: {value!r}" for path, value in ParseOverrides(overrides)],
    }


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
