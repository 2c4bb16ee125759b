"""Plain data behind scenarios: YAML, overrides, types, and what is said of bad input.

A "tree" is what YAML knows: dict, list, str, float, int, bool and None.
"""

import copy
import dataclasses
import difflib
import functools
import math
import os
import re
import reprlib
import stat
import types
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from pydrake.common.yaml import yaml_load_typed
from pydrake.systems.analysis import SimulatorConfig

_T = TypeVar("_T")

# The fields of SimulatorConfig that every supported Drake has, so that a scenario
# written by one version can be read by another.
_SIMULATOR_FIELDS: dict[str, type] = {
    "integration_scheme": str,
    "max_step_size": float,
    "accuracy": float,
    "use_error_control": bool,
    "start_time": float,
    "target_realtime_rate": float,
}


class ScenarioError(ValueError):
    """Bad input. Its text is one line: the field, its value and what is allowed."""


# The default of a field that has none: `yaml_load_typed` needs every class to be
# constructible without arguments. `Validate` refuses it.
REQUIRED: Any = None


# Messages.


class _ShortRepr(reprlib.Repr):
    """repr() on one short line, also of numbers that Python refuses to write out."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = self.maxlong = 60

    def repr_int(self, x: int, level: int) -> str:
        """Returns the digits, or those of the hexadecimal number if there are many."""
        is_long = x.bit_length() > 1000
        return self.repr_instance(hex(x), level)[1:-1] if is_long else repr(x)


_SHORT = _ShortRepr()


def Show(value: Any) -> str:
    """Returns the value as YAML would write it, on one short line."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    return _SHORT.repr(value)


def Refuse(path: str, value: Any, allowed: str) -> typing.NoReturn:
    """Raises a ScenarioError.

    Args:
        path: The field, dotted.
        value: What it has.
        allowed: What it must be, after "must be".
    """
    raise ScenarioError(f"{path} = {Show(value)}: must be {allowed}")


def Choices(value: Any, choices: Iterable[str]) -> str:
    """Returns "one of a, b (did you mean 'a'?)"."""
    choices = list(choices)
    text = "one of " + ", ".join(choices)
    nearest = difflib.get_close_matches(str(value), choices, n=1, cutoff=0.5)
    return f"{text} (did you mean {nearest[0]!r}?)" if nearest else text


# Reading and writing.

# The one in C where PyYAML has it.
_FastDumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

# Numbers that people write and YAML 1.1 takes for text: it asks for a dot, for a sign
# of the exponent, and for a digit between sign and dot. 1e-2, 1.5e3, -.5
_FLOAT = re.compile(
    r"^[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)[eE][-+]?[0-9]+$"
    r"|^[-+]\.[0-9][0-9_]*$"
)

# No number needs so many, and Python refuses to read many more.
_MAX_DIGITS = 1000


class _Loader(yaml.SafeLoader):
    """YAML's safe loader with the numbers that people write, and strict about keys.

    PyYAML's own lets the last of equal keys win.
    """

    def construct_yaml_int(self, node: Any) -> int:
        if len(node.value) > _MAX_DIGITS:
            raise yaml.constructor.ConstructorError(
                None,
                None,
                f"a number of {len(node.value)} digits is too long",
                node.start_mark,
            )
        return int(super().construct_yaml_int(node))

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        keys = set()
        for key_node, _ in node.value:
            if key_node.value in keys and isinstance(key_node, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(
                    None, None, f"duplicate key {key_node.value!r}", key_node.start_mark
                )
            if isinstance(key_node, yaml.ScalarNode):
                keys.add(key_node.value)
        return super().construct_mapping(node, deep)


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


class _Dumper(yaml.SafeDumper):
    """YAML's safe dumper, which puts text that _Loader takes for a number in quotes."""


for _class in (_Loader, _Dumper):
    _class.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, [*"-+.0123456789"])


def DumpYaml(tree: Any, **options: Any) -> str:
    """Returns a YAML text from which ParseYaml() gives the same tree.

    Args:
        tree: What to write.
        **options: As yaml.dump() takes them.
    """
    return str(yaml.dump(tree, Dumper=_Dumper, **options))


def ParseYaml(text: str, origin: str) -> Any:
    """Returns the tree of a YAML text.

    It is YAML 1.1, in which 1_000 and 0x10 are numbers, and so are 1e-2, +1e3 and -.5,
    which YAML 1.1 takes for text.

    Args:
        text: The text.
        origin: What it is, for messages.

    Raises:
        ScenarioError: if it is not YAML, or a key stands twice.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except Exception as e:
        # PyYAML's constructors also let ValueError, KeyError and more escape, for
        # example on `2020-13-01`.
        reason = getattr(e, "problem", None) or e
        mark = getattr(e, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        message = " ".join(f"{origin}{where}: must be valid YAML ({reason})".split())
        raise ScenarioError(message) from None


def _Origin(path: Path) -> str:
    return f"scenario file {str(path)!r}"


def ReadText(path: Path) -> str:
    """Returns the text of a scenario file.

    Raises:
        ScenarioError: if it cannot be read.
    """
    origin = _Origin(path)
    try:
        status = os.stat(path)
        if stat.S_ISREG(status.st_mode):
            return path.read_text(encoding="utf-8")
        return _ReadOnce(path, status.st_dev, status.st_ino)
    except OSError as e:
        raise ScenarioError(f"{origin}: must be readable ({e.strerror})") from None
    except ValueError:  # Not UTF-8, or a NUL in the name.
        raise ScenarioError(f"{origin}: must be readable as UTF-8 text") from None


@functools.lru_cache(maxsize=16)
def _ReadOnce(path: Path, device: int, inode: int) -> str:
    """Returns what a pipe or a terminal has: it says that once, and is asked often.

    Args:
        path: Such as /dev/stdin.
        device: With the inode, which of those that have had this name it is.
        inode: See above.
    """
    return path.read_text(encoding="utf-8")


def ParseFile(path: Path, text: str) -> dict[Any, Any]:
    """Returns the tree of a scenario file.

    Args:
        path: The file, for messages.
        text: What ReadText() returned.

    Raises:
        ScenarioError: if it does not hold a mapping in YAML.
    """
    origin = _Origin(path)
    tree = ParseYaml(text, origin)
    if not isinstance(tree, dict):
        raise ScenarioError(
            f"{origin}: must hold a mapping of scenario fields, not {Show(tree)}"
        )
    return tree


def ParseOverrides(
    overrides: Mapping[str, Any] | Iterable[str],
) -> list[tuple[str, Any]]:
    """Returns the dotted paths and their new values, trees.

    Args:
        overrides: As for LoadScenario().

    Raises:
        ScenarioError: if a text is not PATH=VALUE with a YAML value.
    """
    if isinstance(overrides, Mapping):
        return [(str(path), ToTree(value)) for path, value in overrides.items()]
    if isinstance(overrides, str):
        overrides = [overrides]
    pairs = []
    for item in overrides:
        path, equals, text = item.partition("=")
        path = path.strip()
        if not equals or not path:
            raise ScenarioError(f"override {Show(item)}: must be PATH=VALUE")
        pairs.append((path, ParseYaml(text, f"override of {Show(path)}")))
    return pairs


def SetPath(tree: Any, dotted: str, value: Any) -> str:
    """Replaces one value in a tree of dicts and lists.

    Args:
        tree: Where to.
        dotted: The path of the value.
        value: What to put there.

    Returns:
        The path with the numbers of elements instead of their names: the same for all
        names of a value.

    Raises:
        ScenarioError: if there is no such value.
    """
    shown = f"{dotted if dotted.isprintable() else Show(dotted)} = {Show(value)}"
    *parents, last = dotted.split(".")
    keys = []
    for part in parents:
        keys.append(_FindKey(tree, part, shown))
        tree = tree[keys[-1]]
    keys.append(_FindKey(tree, last, shown))
    tree[keys[-1]] = value
    return ".".join(map(str, keys))


def _FindKey(tree: Any, part: str, shown: str) -> str | int:
    """Returns the key or index that `part` of a path means in `tree`."""
    if isinstance(tree, dict):
        if part in tree:
            return part
        known = list(tree)
    elif isinstance(tree, list):
        names = [item.get("name") if isinstance(item, dict) else None for item in tree]
        if part in names:
            return names.index(part)
        if part.isdecimal() and int(part) < len(tree):
            return int(part)
        known = [name for name in names if isinstance(name, str)]
        known += [str(i) for i in range(len(tree))]
    else:
        known = []
    allowed = f"must be {Choices(part, known)}" if known else "there is nothing below"
    raise ScenarioError(f"{shown}: unknown key {part!r}, {allowed}")


# Types.


def _Schema(schema: Any) -> dict[str, Any]:
    """Returns the names and types of a class's fields."""
    if schema is SimulatorConfig:
        return _SIMULATOR_FIELDS
    return {item.name: item.type for item in dataclasses.fields(schema)}


def ToTree(value: Any) -> Any:
    """Returns the tree of a dataclass, an array, a list or a plain value."""
    if dataclasses.is_dataclass(value) or isinstance(value, SimulatorConfig):
        return {key: ToTree(getattr(value, key)) for key in _Schema(type(value))}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [ToTree(item) for item in value]
    return value


def FromTree(tree: Any, schema: type[_T]) -> _T:
    """Returns an object with fields of the right types, their values unchecked.

    Args:
        tree: What ToTree() returned, or a file or its user made of it.
        schema: The dataclass of the object.

    Raises:
        ScenarioError: on unknown keys and wrong types.
    """
    # yaml_load_typed is strict too, but names neither the path nor the choices, and
    # takes a bare number neither for `ndarray | float` nor for a vector.
    normal = Normalize(tree, schema, "")
    parts = {
        key: copy.deepcopy(_LoadPart(part, yaml.dump(normal[key], Dumper=_FastDumper)))
        for key, part in _Schema(schema).items()
        if isinstance(part, type)
        and (dataclasses.is_dataclass(part) or part is SimulatorConfig)
        and key in normal
    }
    plain = {key: value for key, value in normal.items() if key not in parts}
    return yaml_load_typed(
        schema=schema,
        data=yaml.dump(plain, Dumper=_FastDumper),
        defaults=schema(**parts),
    )


@functools.lru_cache(maxsize=128)
def _LoadPart(schema: type, data: str) -> Any:
    """Returns an object of a part of a scenario; in a sweep most parts do not vary."""
    return yaml_load_typed(schema=schema, data=data)


def Normalize(value: Any, schema: Any, path: str) -> Any:
    """Checks the tree against the schema; makes numbers of the declared type.

    Raises:
        ScenarioError: on unknown keys and wrong types.
    """
    options = (
        typing.get_args(schema) if isinstance(schema, types.UnionType) else (schema,)
    )
    if value is None and type(None) in options:
        return None
    options = tuple(option for option in options if option is not type(None))
    if options == (str,):
        return _NormalizeText(value, path)
    if options == (bool,):
        if not isinstance(value, bool):
            Refuse(path, value, "true or false")
        return value
    if options == (float,):
        return _NormalizeNumber(value, path, "a number")
    if options == (int,):
        return _NormalizeCounts([value], path, "a whole number")[0]
    if options == (list[int],):
        return _NormalizeCounts(value, path)
    if np.ndarray in options:
        if options == (np.ndarray,):
            if not isinstance(value, list):
                value = [value]
            return [_NormalizeNumber(x, path, "a list of numbers") for x in value]
        return _NormalizeGain(value, path, allow_text=str in options)
    if typing.get_origin(schema) is list:
        (item_schema,) = typing.get_args(schema)
        if not isinstance(value, list):
            Refuse(path, value, "a list")
        return [
            Normalize(item, item_schema, f"{path}.{ElementName(item, i)}")
            for i, item in enumerate(value)
        ]
    return _NormalizeMapping(value, schema, path)


def _NormalizeMapping(value: Any, schema: Any, path: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        keys = ", ".join(_Schema(schema))
        Refuse(path or "scenario", value, f"a mapping with the keys {keys}")
    fields = _Schema(schema)
    prefix = f"{path}." if path else ""
    for key in value:
        if key not in fields:
            name = key if isinstance(key, str) and key.isprintable() else Show(key)
            raise ScenarioError(
                f"{prefix}{name} = {Show(value[key])}: unknown key {Show(key)}, "
                f"must be {Choices(key, fields)}"
            )
    result = {}
    for key, item_schema in fields.items():
        # A required field that is null is left for Validate to name.
        is_required = getattr(schema, key, 0) is None and not (
            isinstance(item_schema, types.UnionType)
            and type(None) in typing.get_args(item_schema)
        )
        if key in value and not (is_required and value[key] is None):
            result[key] = Normalize(value[key], item_schema, prefix + key)
    return result


def _NormalizeText(value: Any, path: str) -> str:
    if not isinstance(value, str):
        Refuse(path, value, "text")
    try:
        value.encode("utf-8")
    except UnicodeError:
        Refuse(path, value, "text that UTF-8 can express")
    return value


def _NormalizeNumber(value: Any, path: str, allowed: str) -> float:
    # Text as well: a number in quotes is one.
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:
            return float(value)
        except (ValueError, OverflowError):
            pass
    Refuse(path, value, allowed)


def _NormalizeCounts(
    value: Any, path: str, allowed: str = "a list of whole numbers"
) -> list[int]:
    values = value if isinstance(value, list) else [value]
    counts = []
    for item in values:
        number = _NormalizeNumber(item, path, allowed)
        if not number.is_integer():
            Refuse(path, item if allowed == "a whole number" else value, allowed)
        counts.append(int(number))
    return counts


def _NormalizeGain(value: Any, path: str, allow_text: bool) -> Any:
    allowed = "a number or a matrix (a list of rows)"
    if allow_text:
        allowed += " or auto"
    if value == "auto" and allow_text:
        return value
    if not isinstance(value, list):
        return _NormalizeNumber(value, path, allowed)
    rows = []
    for row in value:
        if not isinstance(row, list) or len(row) != len(value):
            Refuse(path, value, allowed + ", square")
        rows.append([_NormalizeNumber(x, path, allowed) for x in row])
    return rows


def ElementName(item: Any, index: int) -> str:
    """Returns how messages call an element of a list."""
    name = item.get("name") if isinstance(item, dict) else None
    return name if isinstance(name, str) and name.isidentifier() else str(index)


# Values.


def CheckNumber(
    path: str,
    value: Any,
    unit: str = "",
    *,
    above: float | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
) -> None:
    """Refuses what is not finite or not within the bounds; takes None for missing."""
    bounds = []
    if above is not None:
        bounds.append(f"> {above:g}")
    if minimum is not None:
        bounds.append(f">= {minimum:g}")
    if maximum is not None:
        bounds.append(f"<= {maximum:g}")
    allowed = ["a finite number", " and ".join(bounds), f"({unit})" if unit else ""]
    if (
        value is None
        or not math.isfinite(value)
        or (above is not None and value <= above)
        or (minimum is not None and value < minimum)
        or (maximum is not None and value > maximum)
    ):
        Refuse(path, value, " ".join(filter(None, allowed)))


def CheckVector(path: str, value: Any, size: int, unit: str) -> None:
    """Refuses what is not a vector of finite numbers; takes None for missing."""
    if value is None or len(value) != size or not np.all(np.isfinite(value)):
        entries = "1 finite number" if size == 1 else f"{size} finite numbers"
        Refuse(path, value, f"a list of {entries} ({unit})")


def CheckChoice(path: str, value: Any, choices: Iterable[str]) -> None:
    """Refuses what is none of the choices."""
    if value not in choices:
        Refuse(path, value, Choices(value, choices))
