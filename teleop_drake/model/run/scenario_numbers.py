"""The numbers of a scenario in Contexts of its diagram, by the fields that set them.

A config tells in Numbers() which of its fields are numbers of its blocks. The numbers
of an architecture are those of its config after Resolve(), so that a default changes
with the fields from which it derives.
"""

from typing import Any, NamedTuple

from pydrake.systems.framework import System

from teleop_drake.loops.engine.parameters import NamedParameters
from teleop_drake.loops.framework.arrays import Record
from teleop_drake.model.kinds import KindConfig, NumberNames
from teleop_drake.model.scenario import AnyScenario
from teleop_drake.model.scenario.tree import ToTree
from teleop_drake.model.stations import ResolveController
from teleop_drake.model.tasks import TaskOf

# Sections of a scenario on which no block depends.
_OF_THE_RUN = (
    *("name", "title", "description", "story", "source"),
    *("simulator", "divergence_speed_ratio"),
)

# The blocks that are made by sections of a scenario, besides the channels.
_PLACES = {"environment": "environment", "surgeon": "master/surgeon"}

# Blocks of the master station that no architecture makes.
_OF_MASTER = ("master/surgeon.", "master/haptic_device")


class _Fields(NamedTuple):
    """The fields of a scenario by their dotted paths.

    Attributes:
        values: Their values, also those of what derives from them.
        names: The full names in a Context of the fields that are numbers.
    """

    values: Record
    names: dict[str, list[str]]


class ScenarioNumbers:
    """The numbers of a scenario, to be compared with those of changed scenarios.

    Args:
        scenario: The scenario.
        diagram: Its diagram.
    """

    def __init__(self, scenario: AnyScenario, diagram: System):
        self._known = list(NamedParameters(diagram))
        self._fields = self._Read(scenario)

    def Changed(self, scenario: AnyScenario) -> Record | None:
        """Returns the changed numbers by their names in a Context; see SetNumbers().

        Returns None if a changed field needs another diagram.
        """
        values, names = self._Read(scenario)
        if values.keys() != self._fields.values.keys():
            return None
        numbers: Record = {}
        for path, value in values.items():
            if value == self._fields.values[path]:
                continue
            if path not in names or path not in self._fields.names:
                return None
            numbers |= dict.fromkeys(names[path], value)
        return numbers

    def _Read(self, scenario: Any) -> _Fields:
        """Returns the fields of a scenario."""
        tree = ToTree(scenario)
        for section in _OF_THE_RUN:
            tree.pop(section, None)
        channels = TaskOf(scenario).Channels(scenario)
        if not channels:
            return _Fields(_Leaves(tree), {})
        names: dict[str, list[str]] = {}
        controller = scenario.controller
        chosen = controller.Chosen()
        own = NumbersOf(chosen)
        # Without them, all that is known is whether the architecture uses the channels.
        is_free = IsOfPackage(chosen) and not chosen.derives_from_channels
        places = {} if own is None and not is_free else {x: x for x in channels}
        if own is not None:
            places |= _PLACES
            tree["derived"] = ToTree(ResolveController(scenario))
            for field, numbers in own.items():
                names[f"{controller.path}.{field}"] = []
                names[f"derived.{field}"] = [x for y in numbers for x in self._Find(y)]
            # No Context has the planes at which an operator perceives contact.
            tree["planes"] = [
                [x.name, x.point_W.tolist(), x.normal_W.tolist()]
                for x in scenario.Surfaces()
            ]
        for section, place in places.items():
            for field, numbers in (NumbersOf(getattr(scenario, section)) or {}).items():
                names[f"{section}.{field}"] = [f"{place}.{x}" for x in numbers]
        if all(f"{channel}.duration" in names for channel in channels):
            names["duration"] = []
        return _Fields(_Leaves(tree), names)

    def _Find(self, name: str) -> list[str]:
        """Returns the full names of a number of the architecture, `side.number`."""
        side, _, number = name.partition(".")
        return [
            known
            for known in self._known
            if known.startswith(side)
            and known.endswith(f".{number}")
            and not known.startswith(_OF_MASTER)
        ]


def NumbersOf(config: KindConfig) -> NumberNames | None:
    """Returns config.Numbers(); None for a user's kind, which may inherit them."""
    return config.Numbers() if IsOfPackage(config) else None


def IsOfPackage(item: object) -> bool:
    """Returns whether the class of an object is defined in this package."""
    return type(item).__module__.startswith("teleop_drake.")


def _Leaves(tree: Any, path: str = "") -> Record:
    """Returns the values in nested mappings and lists of mappings, by dotted paths."""
    if isinstance(tree, dict):
        parts = tree
    elif isinstance(tree, list) and any(isinstance(x, dict) for x in tree):
        parts = dict(enumerate(tree))
    else:
        return {path: tree}
    leaves: Record = {}
    for key, value in parts.items():
        leaves |= _Leaves(value, f"{path}.{key}" if path else str(key))
    return leaves
