"""Overrides of a scenario: dotted paths of fields in a tree, and their new values."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from teleop_drake.loops.framework.arrays import Record
from teleop_drake.loops.framework.validation import Choices, ScenarioError, Show
from teleop_drake.model.scenario.tree import ToTree
from teleop_drake.model.scenario.yaml_text import ParseYaml

# The largest number of paths that a message suggests.
_MOST_PATHS = 3

CHANNELS = ("forward_channel", "return_channel")
"""The fields of a Scenario that are channels."""

DELAYS = ("forward_channel.delay", "return_channel.delay")
"""The fields that the key `delay` sets, in files and overrides."""

ALIASES = {
    "channel": CHANNELS,
    "controller": ("controller.kind",),
    "delay": DELAYS,
    "forward_delay": DELAYS[:1],
    "return_delay": DELAYS[1:],
    "seed": ("forward_channel.seed", "return_channel.seed"),
}
"""Short names of fields, for overrides and for keys that vary."""

Override = str | tuple[str, Any]
"""A text PATH=VALUE with a YAML value, or a dotted path with its value."""

Overrides = Mapping[str, Any] | Sequence[Override]
"""Overrides in any form that LoadScenario() accepts."""


def FieldsOf(key: str, value: Any = None) -> Sequence[str]:
    """Returns the dotted paths of the fields that a key sets.

    Args:
        key: A dotted path, or one of ALIASES.
        value: The new value. With a mapping, `controller` is the whole section instead
            of `controller.kind`.
    """
    if key == "controller" and isinstance(value, Mapping):
        return (key,)
    return ALIASES.get(key, (key,))


def ParseOverrides(overrides: Overrides) -> list[tuple[str, Any]]:
    """Returns the dotted paths of fields and their new values, which are trees.

    Args:
        overrides: A mapping of dotted paths to values, or a list of overrides. A path
            may be one of ALIASES.
    """
    if isinstance(overrides, str):
        overrides = [overrides]
    items = overrides.items() if isinstance(overrides, Mapping) else overrides
    pairs = []
    for item in items:
        key, value = _ParseOverride(item) if isinstance(item, str) else item
        # Each field gets its own copy, because later overrides may change parts of it.
        pairs += [(path, ToTree(value)) for path in FieldsOf(str(key), value)]
    return pairs


def _ParseOverride(item: str) -> tuple[str, Any]:
    path, equals, text = item.partition("=")
    path = path.strip()
    if not equals or not path:
        raise ScenarioError(f"override {Show(item)}: must be PATH=VALUE")
    return path, ParseYaml(text, f"override of {Show(path)}")


def GetPath(tree: Any, dotted: str) -> Any:
    """Returns one value in a tree of dicts and lists.

    Raises:
        ScenarioError: If there is no such path.
    """
    for part in dotted.split("."):
        tree = tree[_FindKey(tree, part, dotted)]
    return tree


def SetFields(tree: Any, overrides: Overrides) -> list[str]:
    """Replaces values in the complete tree of a scenario.

    Returns:
        The paths as SetPath() returns them.
    """
    replaced = []
    for path, value in ParseOverrides(overrides):
        _CheckBegin(tree, path, value)
        replaced.append(SetPath(tree, path, value))
    return replaced


def SetPath(tree: Any, dotted: str, value: Any) -> str:
    """Replaces one value in a tree of dicts and lists.

    A key that a mapping lacks is added, because the mapping may leave out fields that
    have a default. FromTree() refuses keys that are not fields of the mapping's kind.

    Returns:
        The path with the numbers of a list's elements instead of their names, which is
        unique for each value.
    """
    keys: list[str | int] = []
    for part in dotted.split("."):
        if keys:
            tree = tree[keys[-1]]
        if isinstance(tree, dict):
            keys.append(part)
            tree.setdefault(part, {})
        else:
            keys.append(_FindKey(tree, part, _Shown(dotted, value)))
    tree[keys[-1]] = value
    return ".".join(map(str, keys))


def _Shown(dotted: str, value: Any) -> str:
    """Returns the text of an override in messages."""
    return f"{dotted if dotted.isprintable() else Show(dotted)} = {Show(value)}"


def _CheckBegin(tree: Any, dotted: str, value: Any) -> None:
    """Refuses a path whose first key is unknown.

    If the path is the end of known paths, the message suggests the full paths.
    """
    first = dotted.partition(".")[0]
    if first in tree:
        return
    shown = _Shown(dotted, value)
    full = [path for path in _Paths(tree) if path.endswith(f".{dotted}")]
    if full:
        more = ", ..." if len(full) > _MOST_PATHS else ""
        paths = " or ".join(full[:_MOST_PATHS])
        raise ScenarioError(f"{shown}: must be the full path, {paths}{more}")
    _FindKey(tree, first, shown)


def _Paths(tree: Any, prefix: str = "") -> Iterator[str]:
    """Yields the dotted paths of a tree; only named elements of lists are included."""
    for key, place in _Places(tree).items():
        if isinstance(tree, dict) or not key.isdecimal():
            path = f"{prefix}{key}"
            yield path
            yield from _Paths(tree[place], f"{path}.")


def _Places(tree: Any) -> Record:
    """Returns the keys of a mapping or indices of a list by the parts of a path.

    An element of a list has its number and, if it has one, its name as parts.
    """
    if isinstance(tree, dict):
        return {key: key for key in tree}
    places: Record = {}
    if isinstance(tree, list):
        for i, item in enumerate(tree):
            if isinstance(item, dict) and isinstance(item.get("name"), str):
                places.setdefault(item["name"], i)
        places |= {str(i): i for i in range(len(tree))}
    return places


def _FindKey(tree: Any, part: str, shown: str) -> str | int:
    """Returns the key or index of `tree` that a part of a path means.

    Args:
        tree: A mapping or a list.
        part: The part of the path.
        shown: The override or path in messages.

    Raises:
        ScenarioError: If there is no such key or element.
    """
    places = _Places(tree)
    if part in places:
        key: str | int = places[part]
        return key
    known = [*places]
    if "forward_channel" in places:
        known.append("delay")  # The alias for both channels.
    allowed = f"must be {Choices(part, known)}" if known else "there is nothing below"
    raise ScenarioError(f"{shown}: unknown key {part!r}, {allowed}")
