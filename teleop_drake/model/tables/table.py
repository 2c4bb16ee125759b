"""A table of measurements: named columns of a file."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Indices
from teleop_drake.loops.framework.validation import Choices, ScenarioError, Show
from teleop_drake.model.tables.headers import UNITS, CleanUnit, ParseHeader
from teleop_drake.model.tables.losses import AreLost
from teleop_drake.model.tables.stamps import ReadTimes, RefuseCell, Times

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, kw_only=True)
class Table:
    """The named columns of a file.

    Attributes:
        origin: The beginning of messages: the field and the file.
        frame: The cells, a column for each name; without a header, the names are the
            numbers of the columns, `1`, `2` and so on.
        lines: The number of each row's line in the file, from 1 (N).
        has_header: Whether the file names its columns.
        comments: The comments of the file.
        units: Units that stand in a line of their own, by the column's name.
    """

    origin: str
    frame: "pandas.DataFrame"
    lines: Indices
    has_header: bool
    comments: Sequence[str] = ()
    units: dict[str, str] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Returns the names of the columns."""
        return [str(name) for name in self.frame.columns]

    def Find(self, column: str | int) -> str:
        """Returns the name of a column that is given by its name or number from 1.

        Raises:
            ScenarioError: If there is no such column.
        """
        names = self.names
        if str(column) in names:
            return str(column)
        folded = [x for x in names if x.casefold() == str(column).strip().casefold()]
        if len(folded) == 1:
            return folded[0]
        if str(column).isdecimal() and 1 <= int(column) <= len(names):
            return names[int(column) - 1]
        raise ScenarioError(
            f"{self.origin}: column {Show(column)}: must be "
            f"{Choices(column, names)}, or a number from 1 to {len(names)}"
        )

    def UnitOf(self, column: str) -> str:
        """Returns the unit that the file names for a column; empty if there is none."""
        return self.units.get(column) or ParseHeader(column).unit

    def Place(self, column: str) -> str:
        """Returns the beginning of a message about a column."""
        return f"{self.origin}: column {Show(column)}"

    def Texts(self, column: str) -> Array:
        """Returns the cells of a column as texts (N)."""
        return self.frame[column].map(str).to_numpy(dtype=object)

    def Values(
        self, column: str, unit: str | None = None, *, minus_one_is_lost: bool = False
    ) -> Array:
        """Returns the numbers of a column, in SI if their unit is known (N).

        A word for a lost packet or a missing value gives NaN.

        Args:
            column: The name of the column.
            unit: The unit; None: the one that the file names, if it names one.
            minus_one_is_lost: Whether the number -1 stands for a lost packet.

        Raises:
            ScenarioError: If a cell is neither a finite number nor such a word, or if
                the unit is unknown.
        """
        import pandas

        cells = self.frame[column]
        unit = self.UnitOf(column) if unit is None else CleanUnit(unit)
        if unit and unit not in UNITS:
            raise ScenarioError(
                f"{self.Place(column)}: unit {Show(unit)}: must be one of the known "
                f"units: {', '.join(UNITS)}"
            )
        numbers = pandas.to_numeric(cells, errors="coerce")
        # pandas makes numbers of dates as well.
        if numbers.dtype.kind not in "iuf" or cells.dtype.kind in "bM":
            raise ScenarioError(f"{self.Place(column)}: must have numbers")
        values: Array = numbers.to_numpy(dtype=float, na_value=np.nan)
        if pandas.api.types.is_numeric_dtype(cells.dtype):
            is_lost = ~np.isfinite(values)
        else:
            is_lost = AreLost(cells)
            is_bad = ~np.isfinite(values) & ~is_lost
            allowed = "a finite number, or a word for a missing one"
            RefuseCell(self.Place(column), self.lines, cells, is_bad, allowed)
        if minus_one_is_lost:
            is_lost |= values == -1
        values = np.where(is_lost, np.nan, values)
        return values * (UNITS[unit].factor if unit else 1.0)

    def Times(self, column: str, unit: str | None = None) -> Times:
        """Returns the times of a column.

        Args:
            column: The name of the column.
            unit: The unit; None: the one that the file names, if it names one.

        Raises:
            ScenarioError: If a cell is no time.
        """
        unit = self.UnitOf(column) if unit is None else CleanUnit(unit)
        return ReadTimes(self.frame[column], unit, self.Place(column), self.lines)
