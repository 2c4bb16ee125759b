"""Conversion between the configs of a scenario and trees of plain data.

A tree consists of the types of YAML: dict, list, str, float, int, bool and None.
"""

import copy
import copyreg
import dataclasses
import functools
import math
import types
import typing
from collections.abc import Callable, Iterable
from typing import Any, NoReturn, TypeVar

import numpy as np
from pydrake.systems.analysis import SimulatorConfig

from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.loops.framework.validation import Choices, Refuse, ScenarioError, Show
from teleop_drake.model.kinds import KindConfig, KindTable, TableOf

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


def _ReduceSimulator(config: SimulatorConfig) -> tuple[Any, tuple[()]]:
    values = {x.name: getattr(config, x.name) for x in SimulatorConfig.__fields__}
    return functools.partial(SimulatorConfig, **values), ()


# SimulatorConfig cannot be pickled by itself.
copyreg.pickle(SimulatorConfig, _ReduceSimulator)


def _FieldTypes(schema: Any) -> Record:
    """Returns the types of a config's fields by their names."""
    if schema is SimulatorConfig:
        return _SIMULATOR_FIELDS
    return {item.name: item.type for item in dataclasses.fields(schema)}


FieldTypes: Callable[[Any], Record] = functools.cache(_FieldTypes)


_PLAIN = {str, float, int, bool, type(None)}


def ToTree(value: Any) -> Any:
    """Returns the tree of a config, an array, a list, a dict or a plain value."""
    if type(value) in _PLAIN:  # The most frequent case.
        return value
    if dataclasses.is_dataclass(value) or isinstance(value, SimulatorConfig):
        schemas = FieldTypes(type(value))
        return {key: _FieldToTree(getattr(value, key), schemas[key]) for key in schemas}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [ToTree(item) for item in value]
    if isinstance(value, dict):
        return {key: ToTree(item) for key, item in value.items()}
    return value


def _FieldToTree(value: Any, schema: Any) -> Any:
    """Returns the tree of a field, with its kind if the field's type allows several."""
    table = TableOf(schema)
    if table is None or value is None:
        return ToTree(value)
    return {table.key: value.kind, **ToTree(value)}


def FromTree(tree: Any, schema: type[_T]) -> _T:
    """Returns a config whose fields have the right types. Values are not checked.

    Args:
        tree: A tree made by ToTree(), or read from a file or edited by a user.
        schema: The class of the config.

    Raises:
        ScenarioError: If a key is unknown or a value is of the wrong type.
    """
    config: _T = _Build(tree, schema, "")
    return config


def _MayBeNull(schema: Any) -> bool:
    return type(None) in typing.get_args(schema)


def _Build(value: Any, schema: Any, path: str) -> Any:
    """Returns the value that a tree describes, of a field's declared type.

    Args:
        value: The tree.
        schema: The declared type.
        path: The dotted path of the field, for messages.
    """
    if value is None and _MayBeNull(schema):
        return None
    if isinstance(schema, types.UnionType):
        # A union is a gain (a number or a matrix, perhaps also auto), a file (a path or
        # a mapping), or one type that may be null.
        options = [x for x in typing.get_args(schema) if x is not type(None)]
        if len(options) > 1 and np.ndarray in options:
            return _BuildGain(value, path, allow_text=str in options)
        if len(options) > 1:  # GivenFile
            if isinstance(value, dict):
                return copy.deepcopy(value)
            options.remove(dict[str, Any])
        (schema,) = options
    if schema in _BUILDERS:
        return _BUILDERS[schema](value, path)
    if typing.get_origin(schema) is dict:
        _CheckMapping(value, ["your own"], path)
        return copy.deepcopy(value)
    if typing.get_origin(schema) is list:
        (item_schema,) = typing.get_args(schema)
        if item_schema is int and not isinstance(value, list):
            value = [value]
        if not isinstance(value, list):
            Refuse(path, value, "a list")
        return [
            _Build(item, item_schema, f"{path}.{_ElementName(item, i)}")
            for i, item in enumerate(value)
        ]
    table = TableOf(schema)
    if table is not None:
        return _BuildKind(value, table, path)
    return _BuildConfig(value, schema, path)


def _BuildConfig(value: Any, schema: Any, path: str) -> Any:
    """Returns a config of the class `schema` from a mapping."""
    fields = FieldTypes(schema)
    _CheckMapping(value, fields, path)
    prefix = f"{path}." if path else ""
    built = {}
    for key, item in value.items():
        if key not in fields:
            _RefuseKey(prefix, key, item, fields)
        # A required field that is null is left out: the config's checks report it.
        is_required = getattr(schema, key, 0) is None and not _MayBeNull(fields[key])
        if item is not None or not is_required:
            built[key] = _Build(item, fields[key], prefix + key)
    return schema(**built)


def _BuildKind(value: Any, table: KindTable[Any], path: str) -> Any:
    """Returns a config of the kind that a mapping names."""
    first = table.kinds[0]
    _CheckMapping(value, [table.key, *FieldTypes(first)], path)
    default = None if table.is_named else first.kind
    kind = table.Find(value.get(table.key, default), f"{path}.{table.key}")
    fields = FieldTypes(kind)
    for key in value:
        if key not in fields and key != table.key:
            _CheckForeign(value[key], key, kind, table, path)
    own = {key: item for key, item in value.items() if key in fields}
    return _BuildConfig(own, kind, path)


def _CheckForeign(
    value: Any, key: Any, kind: type[KindConfig], table: KindTable[Any], path: str
) -> None:
    """Accepts a field of another kind if it has that kind's default value.

    A scenario can therefore be changed from one kind to another by its `kind` only.

    Raises:
        ScenarioError: If no kind has such a field, or the field has another value.
    """
    other = next((x for x in table.kinds if key in FieldTypes(x)), None)
    if other is None:
        _RefuseKey(f"{path}.", key, value, [table.key, *FieldTypes(kind)])
    place = f"{path}.{key}"
    given = ToTree(_Build(value, FieldTypes(other)[key] | None, place))
    neutral = ToTree(getattr(other(), key))
    fields = [(place, given, neutral)]
    if isinstance(neutral, dict) and isinstance(given, dict):
        fields = [(f"{place}.{x}", given[x], neutral[x]) for x in neutral]
    for place, actual, expected in fields:
        if actual != expected:
            Refuse(place, actual, f"{Show(expected)} for the {kind.kind} {table.noun}")


def _CheckMapping(value: Any, keys: Iterable[str], path: str) -> None:
    if not isinstance(value, dict):
        allowed = f"a mapping with the keys {', '.join(keys)}"
        Refuse(path or "scenario", value, allowed)


def _RefuseKey(prefix: str, key: Any, value: Any, allowed: Iterable[str]) -> NoReturn:
    name = key if isinstance(key, str) and key.isprintable() else Show(key)
    raise ScenarioError(
        f"{prefix}{name} = {Show(value)}: unknown key {Show(key)}, "
        f"must be {Choices(key, allowed)}"
    )


def _BuildText(value: Any, path: str) -> str:
    if not isinstance(value, str):
        Refuse(path, value, "text")
    try:
        value.encode("utf-8")
    except UnicodeError:
        Refuse(path, value, "text that UTF-8 can express")
    return value


def _BuildBool(value: Any, path: str) -> bool:
    if not isinstance(value, bool):
        Refuse(path, value, "true or false")
    return value


def _BuildNumber(value: Any, path: str, allowed: str = "a number") -> float:
    """Returns a number, which may be in quotes, if its magnitude is usable."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        Refuse(path, value, allowed)
    try:
        number = float(value)
    except (ValueError, OverflowError):
        Refuse(path, value, allowed)
    # Infinity and NaN are not refused here, but by the checks of the field.
    is_usable = number == 0 or _SMALLEST <= abs(number) <= _LARGEST
    if math.isfinite(number) and not is_usable:
        size = f"0, or {_SMALLEST:g} to {_LARGEST:g} in size"
        Refuse(path, value, f"{allowed} ({size})")
    return number


# Products and powers of numbers within these bounds neither overflow nor vanish.
_SMALLEST = 1e-30
_LARGEST = 1e30


def _BuildCount(value: Any, path: str) -> int:
    number = _BuildNumber(value, path, "a whole number")
    if not number.is_integer():
        Refuse(path, value, "a whole number")
    return int(number)


def _BuildVector(value: Any, path: str) -> Array:
    values = value if isinstance(value, list) else [value]
    return np.array([_BuildNumber(x, path, "a list of numbers") for x in values])


def _BuildGain(value: Any, path: str, allow_text: bool) -> float | str | Array:
    allowed = "a number or a matrix (a list of rows)" + " or auto" * allow_text
    if value == "auto" and allow_text:
        return "auto"
    if not isinstance(value, list):
        return _BuildNumber(value, path, allowed)
    if any(not isinstance(row, list) or len(row) != len(value) for row in value):
        Refuse(path, value, allowed + ", square")
    rows = [[_BuildNumber(x, path, allowed) for x in row] for row in value]
    return np.array(rows, dtype=float)


_BUILDERS: dict[Any, Callable[[Any, str], Any]] = {
    str: _BuildText,
    bool: _BuildBool,
    float: _BuildNumber,
    int: _BuildCount,
    np.ndarray: _BuildVector,
}


def _ElementName(item: Any, index: int) -> str:
    """Returns the name of a list's element in messages: its `name` or its index."""
    name = item.get("name") if isinstance(item, dict) else None
    return name if isinstance(name, str) and name.isidentifier() else str(index)
