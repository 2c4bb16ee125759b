"""Tables of measurements, as markdown to read and as plain data to compare."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any


@dataclass(kw_only=True)
class Table:
    """Rows of named cells; `note` says how to read them."""

    name: str
    title: str
    note: str = ""
    rows: list[dict[str, Any]] = field(default_factory=list)

    def Add(self, **cells: Any) -> None:
        """Adds a row; cells are named by the columns, `_` standing for a blank."""
        self.rows.append({key.replace("_", " "): cells[key] for key in cells})

    def Markdown(self) -> str:
        columns = list(dict.fromkeys(key for row in self.rows for key in row))
        lines = [f"## {self.title}", ""]
        if self.note:
            lines += [" ".join(self.note.split()), ""]
        lines.append("| " + " | ".join(columns) + " |")
        lines.append("|" + "---|" * len(columns))
        for row in self.rows:
            cells = [Format(row.get(column)) for column in columns]
            lines.append("| " + " | ".join(cells) + " |")
        return "\n".join([*lines, ""])

    def Numbers(self) -> Iterator[float]:
        """Yields every number in the table."""
        for row in self.rows:
            for value in row.values():
                if isinstance(value, (int, float)):
                    yield float(value)


def Format(value: Any) -> str:
    """Returns a cell as text: three digits of a number, - for none."""
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    if 1e3 <= abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.3g}" if 1e-2 <= abs(value) < 1e3 or not value else f"{value:.1e}"
