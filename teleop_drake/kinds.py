"""Kinds: what may stand in one place of a scenario, by name.

Each seam (channels, architectures, ...) has one table of its kinds. A kind is a config
dataclass that derives from the base of its seam. It checks its own fields, makes its
block, and answers what others may ask, so that nobody needs to know which kind it is.

A kind of a user's own derives from the same base. It is named in a scenario as
`kind: my_module:MyConfig`, or by an entry point of the group `teleop_drake.kinds`. To
look such a kind up imports its module: a scenario that names one is a program.
"""

import dataclasses
import importlib
from collections.abc import Callable, Iterable
from typing import Any, ClassVar, Generic, TypeVar, cast

from teleop_drake.arrays import Names
from teleop_drake.validation import Choices, FixedFields, Refuse, ScenarioError, Show

ENTRY_POINT_GROUP = "teleop_drake.kinds"
"""Group of the entry points that name kinds of other packages."""

KIND_KEYS = ("kind", "model")
"""The keys of a scenario that name a kind; a robot's is `model`."""


class KindConfig(FixedFields):
    """Base of the config dataclasses of all seams.

    Attributes:
        kind: Its name in a scenario. A class that does not set one is called
            `module:Class`.
        file_fields: Names of its fields that hold the path of a file or null. In a
            scenario file such a path is relative to that file.
    """

    kind: ClassVar[str] = ""
    file_fields: ClassVar[Names] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Names the class by its place unless it has a name of its own."""
        super().__init_subclass__(**kwargs)
        if "kind" not in cls.__dict__:
            cls.kind = f"{cls.__module__}:{cls.__qualname__}"


_T = TypeVar("_T", bound=KindConfig)

_tables: dict[type, "KindTable[Any]"] = {}


class KindTable(Generic[_T]):
    """The kinds of one seam.

    Args:
        base: What every kind derives from. A field of a config that has this type is
            read as one of the kinds.
        kinds: Those of the package; the first one is the default.
        noun: What to call one of them in a message.
        key: Which of KIND_KEYS names the kind.
        is_named: Whether a scenario has to name the kind; there is no default then.
        adapt: Returns a kind for an object of a user's own that is no config, or None.
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
        self._kinds = {kind.kind: kind for kind in kinds}
        _tables[base] = self

    @property
    def names(self) -> Names:
        """The names of the kinds of the package."""
        return tuple(self._kinds)

    @property
    def kinds(self) -> tuple[type[_T], ...]:
        """The kinds of the package."""
        return tuple(self._kinds.values())

    def Find(self, name: Any, path: str) -> type[_T]:  # noqa: RET503
        """Returns a kind by its name, or refuses it.

        Args:
            name: One of `names`, `module:Class`, or the name of an entry point.
            path: The field that names it, for messages.
        """
        if isinstance(name, str):
            if name in self._kinds:
                return self._kinds[name]
            places = [name] if ":" in name else _EntryPoints(name)
            if places:
                return self._FromObject(ImportOwn(places[0], path), name, path)
        allowed = f"{Choices(name, self._kinds)}, or module:Class of your own"
        Refuse(path, name, allowed)

    def _FromObject(self, found: Any, name: str, path: str) -> type[_T]:
        """Returns the kind that an imported object is or stands for."""
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
    """Returns what a scenario names as `module:Name`; this runs the module.

    Raises:
        ScenarioError: If it cannot be imported.
    """
    module, _, attribute = place.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except Exception as e:
        # Whatever the user's module raises when it is imported.
        reason = " ".join(f"{type(e).__name__}: {e}".split())
        raise ScenarioError(
            f"{path} = {Show(place)}: must be importable ({reason})"
        ) from e


def IsOwn(name: Any) -> bool:
    """Returns whether a name means a kind of a user's own, without importing it."""
    return isinstance(name, str) and (":" in name or bool(_EntryPoints(name)))


def _EntryPoints(name: str) -> list[str]:
    """Returns what entry points of a name stand for, each as `module:Class`."""
    from importlib import metadata  # It takes longer than all that is asked here.

    found = metadata.entry_points(group=ENTRY_POINT_GROUP, name=name)
    return [entry.value for entry in found]


def TableOf(base: Any) -> "KindTable[Any] | None":
    """Returns the table whose base is this class, or None."""
    return _tables.get(base) if isinstance(base, type) else None
