"""Kinds: the named alternatives for one part of a scenario.

A part with alternatives is called a seam (channels, architectures, ...). Each seam has
one table of kinds. A kind is a config dataclass that derives from the base class of its
seam. It checks its fields, makes its block and has all properties that other code
reads, so that no other code depends on the particular kind.

A user's own kind derives from the same base class. A scenario names it as
`kind: my_module:MyConfig`, or by an entry point of the group `teleop_drake.kinds`. The
lookup imports its module, so a scenario that names such a kind executes its code.
"""

import dataclasses
import importlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, Generic, TypeVar, cast

from teleop_drake.loops.framework.arrays import Names
from teleop_drake.loops.framework.validation import (
    Choices,
    FixedFields,
    Refuse,
    ScenarioError,
    Show,
)

ENTRY_POINT_GROUP = "teleop_drake.kinds"
"""Group of the entry points that name kinds of other packages."""

KIND_KEYS = ("kind", "model")
"""The keys of a scenario that name a kind; a robot's is `model`."""


GivenFile = str | dict[str, Any]
"""The type of a field that names a file: its path, or a mapping {file: path, ...}."""


def FileOf(given: Any) -> str | None:
    """Returns the path of a file that a field names; None: it names none."""
    path = given.get("file") if isinstance(given, dict) else given
    return path if isinstance(path, str) else None


def WithFile(given: GivenFile, path: str) -> GivenFile:
    """Returns what names a file, with another path."""
    return {**given, "file": path} if isinstance(given, dict) else path


NumberNames = Mapping[str, Names]
"""The names of numbers in a Context, by the fields of a config; see KindConfig."""


class KindConfig(FixedFields):
    """Base of the config dataclasses of all seams.

    Attributes:
        kind: The name of the kind in a scenario; `module:Class` if the class does not
            set it.
        file_fields: Names of the fields that contain the path of a file, a mapping
            with the key `file`, or null. In a scenario file such a path is relative to
            that file.
    """

    kind: ClassVar[str] = ""
    file_fields: ClassVar[Names] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Sets `kind` to `module:Class` unless the class sets it."""
        super().__init_subclass__(**kwargs)
        if "kind" not in cls.__dict__:
            cls.kind = f"{cls.__module__}:{cls.__qualname__}"

    def Numbers(self) -> NumberNames | None:
        """Returns the names that fields have in the Contexts of the config's blocks.

        Any other field changes the structure of a diagram, or what no Context has: its
        diagram is made anew. None: so do all fields.
        """
        return None


_T = TypeVar("_T", bound=KindConfig)

_tables: dict[type, "KindTable[Any]"] = {}


class KindTable(Generic[_T]):
    """The kinds of one seam.

    Args:
        base: The base class of the kinds. A field of a config that has this type is
            read as one of the kinds.
        kinds: The kinds of the package; the first one is the default.
        noun: The word for one kind in messages.
        key: The key that names the kind, one of KIND_KEYS.
        is_named: Whether a scenario must name the kind, so that there is no default.
        adapt: A function that returns a kind for a user's object that is no config, or
            None if the object cannot be used.

    Attributes:
        kinds: The kinds of the package.
        names: Their names.
    """

    def __init__(
        self,
        base: type[Any],
        kinds: Iterable[type[_T]],
        *,
        noun: str,
        key: str = "kind",
        is_named: bool = False,
        adapt: Callable[[Any], type[Any] | None] | None = None,
    ):
        self.base = base
        self.noun = noun
        self.key = key
        self.is_named = is_named
        self._adapt = adapt
        self.kinds = tuple(kinds)
        self.names: Names = tuple(kind.kind for kind in self.kinds)
        _tables[base] = self

    def Find(self, name: Any, path: str) -> type[_T]:  # noqa: RET503
        """Returns the kind that has a name.

        Args:
            name: One of `names`, `module:Class`, or the name of an entry point.
            path: The field that contains the name, for messages.

        Raises:
            ScenarioError: If there is no such kind.
        """
        if isinstance(name, str):
            for kind in self.kinds:
                if kind.kind == name:
                    return kind
            places = [name] if ":" in name else _EntryPoints(name)
            if places:
                return self._FromObject(ImportOwn(places[0], path), name, path)
        allowed = f"{Choices(name, self.names)}, or module:Class of your own"
        Refuse(path, name, allowed)

    def _FromObject(self, found: Any, name: str, path: str) -> type[_T]:
        """Returns an imported object if it is a kind, else the kind that adapts it."""
        is_kind = isinstance(found, type) and issubclass(found, self.base)
        if is_kind and dataclasses.is_dataclass(found):
            return cast(type[_T], found)
        adapted = None if self._adapt is None else self._adapt(found)
        if adapted is None:
            base = f"{self.base.__module__}.{self.base.__qualname__}"
            also = ", a System, or a function" if self._adapt else ""
            Refuse(path, name, f"a dataclass that derives from {base}{also}")
        return adapted


def ImportOwn(place: str, path: str) -> Any:
    """Imports and returns the object that a scenario names as `module:Name`.

    Raises:
        ScenarioError: If it cannot be imported.
    """
    module, _, attribute = place.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except Exception as e:
        # A user's module may raise any exception when it is imported.
        reason = " ".join(f"{type(e).__name__}: {e}".split())
        raise ScenarioError(
            f"{path} = {Show(place)}: must be importable ({reason})"
        ) from e


def IsOwn(name: Any) -> bool:
    """Returns whether a name refers to a user's own kind, without importing it."""
    return isinstance(name, str) and (":" in name or bool(_EntryPoints(name)))


def _EntryPoints(name: str) -> list[str]:
    """Returns the `module:Class` of each entry point that has a name."""
    from importlib import metadata  # Imported here because the import is slow.

    found = metadata.entry_points(group=ENTRY_POINT_GROUP, name=name)
    return [entry.value for entry in found]


def TableOf(base: Any) -> "KindTable[Any] | None":
    """Returns the table of kinds that has a base class, or None."""
    return _tables.get(base) if isinstance(base, type) else None
