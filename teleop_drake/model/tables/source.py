"""What a user says about a file of measurements: columns, units."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from teleop_drake.loops.framework.validation import Choices, Refuse, Show
from teleop_drake.model.tables.headers import UNITS, CleanUnit


@dataclass(frozen=True)
class TableSource:
    """A file of measurements, and what its user says of it.

    Attributes:
        path: The field that names the file, such as `forward_channel.trace`.
        file: The file.
        columns: The name or number (from 1) of a column, or a list of them, by role.
        units: The unit of the column of a role, where the header names none.
        options: What else is given, by its key.
    """

    path: str
    file: str
    columns: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def origin(self) -> str:
        """Returns the beginning of messages: the field and the file."""
        return f"{self.path} = {Show(self.file)}"

    def RefuseKeys(self, where: str, *keys: str) -> None:
        """Refuses keys that would have no effect."""
        given = {"columns": self.columns, "units": self.units, **self.options}
        for key in keys:
            if given.get(key):
                Refuse(f"{self.path}.{key}", given[key], f"left out {where}")

    @classmethod
    def Of(
        cls,
        path: str,
        value: Any,
        roles: tuple[str, ...],
        options: tuple[str, ...] = (),
    ) -> "TableSource":
        """Returns the source that a scenario's field describes.

        Args:
            path: The field.
            value: The path of a file, or a mapping {file, columns, units, ...}.
            roles: The roles of columns that are allowed.
            options: The further keys that are allowed.

        Raises:
            ScenarioError: If the value is not allowed.
        """
        if isinstance(value, str):
            return cls(path, value)
        keys = ("file", "columns", "units", *options)
        if not isinstance(value, Mapping) or not isinstance(value.get("file"), str):
            Refuse(
                path,
                value,
                f"a file, or a mapping {{file: ..., {', '.join(keys[1:])}}}",
            )
        for key in value:
            if key not in keys:
                Refuse(f"{path}.{key}", value[key], f"left out: {Choices(key, keys)}")
        for key in ("columns", "units"):
            named = value.get(key) or {}
            if not isinstance(named, Mapping):
                Refuse(f"{path}.{key}", named, f"a mapping of {', '.join(roles)}")
            for role in named:
                if role not in roles:
                    Refuse(f"{path}.{key}.{role}", named[role], Choices(role, roles))
        units = {}
        for role, unit in (value.get("units") or {}).items():
            units[role] = CleanUnit(str(unit))
            if units[role] not in UNITS:
                Refuse(f"{path}.units.{role}", unit, Choices(unit, UNITS))
        return cls(
            path,
            value["file"],
            value.get("columns") or {},
            units,
            {key: value[key] for key in options if value.get(key) is not None},
        )
