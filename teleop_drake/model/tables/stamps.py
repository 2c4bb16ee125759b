"""Columns of times: seconds, stamps since 1970 in any unit, dates, times of day."""

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Flags, Indices
from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.model.tables.headers import UNITS

if TYPE_CHECKING:
    import pandas

DATES = "date stamps"
DAY = "time of day"
SECONDS = "seconds"

# Sizes of numbers that are times since 1970 between 1999 and 2104, by their unit.
# Others, such as those of Windows since 1601, have none of them.
_SINCE_1970 = {"s": 9.4e8, "ms": 9.4e11, "us": 9.4e14, "ns": 9.4e17}
_LARGEST_RATIO = 4.5
# Rows are nearer to each other than this on average, s. The ns since a computer began
# have the size of ms since 1970 after a quarter of an hour, and seem far apart.
_USUAL_STEP = 60.0

# Times in a unit that is named are those of a date from this size on, s, and the
# largest ones, s.
_DATE = 1e8
_LARGEST = 1e10

LENGTH_OF_DAY = 86400.0
"""The length of a day, s."""

_TIME_OF_DAY = re.compile(
    r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)(?: ?([ap])\.?m\.?)?", re.I
)
_ISO = re.compile(
    r"\d{4}[-/]\d\d[-/]\d\d[T ]\d\d:\d\d(:\d\d([.,]\d+)?)?"
    r"\s?(Z|UTC|[+-]\d\d(?::?\d\d)?)?"
)


@dataclass(frozen=True)
class Times:
    """The times of the rows of a table.

    Attributes:
        seconds: The times, s (N). If `is_date`, they count from the first row.
        clock: What the clock shows: DATES, DAY, SECONDS, or such as `ms since 1970`.
        is_date: Whether the clock is that of a wall, so that only differences matter.
        unit: The unit that was read; empty for texts. None: the file names no unit, and
            `seconds` are the numbers of the file.
    """

    seconds: Array
    clock: str
    is_date: bool
    unit: str | None

    @property
    def since_first(self) -> Array:
        """Returns the times since the first row, s (N)."""
        return self.seconds - self.seconds[0]


def ReadTimes(values: "pandas.Series", unit: str, place: str, lines: Indices) -> Times:
    """Returns the times of a column.

    Args:
        values: The cells: texts, numbers or dates.
        unit: The unit that is given or named in the header; empty: there is none.
        place: The file and the column, for messages.
        lines: The numbers of the rows, for messages (N).

    Raises:
        ScenarioError: If a cell is no time, or if the cells are not of one form.
    """
    import pandas

    if pandas.api.types.is_datetime64_any_dtype(values.dtype):
        return _OfDates(values, place, lines)
    numbers = pandas.to_numeric(values, errors="coerce")
    if np.isfinite(numbers.to_numpy(dtype=float, na_value=np.nan)).all():
        return _OfNumbers(values, numbers.to_numpy(), unit, place)
    texts = values.map(str).str.strip()
    first = texts.iloc[0]
    if _TIME_OF_DAY.fullmatch(first):
        return _OfTimesOfDay(texts, place, lines)
    if _ISO.fullmatch(first):
        return _OfIsoTexts(texts, place, lines)
    is_bad = ~np.isfinite(numbers.to_numpy(dtype=float, na_value=np.nan))
    RefuseCell(
        place,
        lines,
        texts,
        is_bad,
        "a finite number, ISO 8601 (2030-05-27T10:59:00.2+02:00) or a time of day "
        "(10:59:00.2)",
    )
    raise AssertionError


def _OfNumbers(values: "pandas.Series", numbers: Any, unit: str, place: str) -> Times:
    """Returns times from numbers in a unit, or from stamps since 1970 in any unit."""
    largest = float(np.max(np.abs(numbers.astype(float))))
    found = [
        x
        for x, size in _SINCE_1970.items()
        if size <= float(numbers.min()) and largest < size * _LARGEST_RATIO
    ]
    span = (largest - float(numbers.min())) * UNITS[found[0]].factor if found else 0.0
    is_dense = span <= _USUAL_STEP * len(numbers)
    if unit:
        CheckTimeUnit(place, unit)
        factor = UNITS[unit].factor
        in_seconds = largest * factor
        if in_seconds >= _LARGEST:
            hint = f"; in {found[0]} they would be times since 1970" if found else ""
            raise ScenarioError(
                f"{place}: times up to {largest:g} {unit}: must be shorter than 300 "
                f"years{hint}"
            )
        is_date = in_seconds >= _DATE
        clock = f"{unit} since 1970" if is_date else SECONDS
        seconds = _Differences(values, numbers) if is_date else numbers.astype(float)
        return Times(seconds * factor, clock, is_date, unit)
    if found and is_dense:
        factor = UNITS[found[0]].factor
        differences = _Differences(values, numbers) * factor
        return Times(differences, f"{found[0]} since 1970", True, found[0])
    if largest >= _DATE:
        raise ScenarioError(
            f"{place}: times up to {largest:g}: must have a unit, in the header or as "
            "that of the time (s, ms, us or ns)"
        )
    return Times(numbers.astype(float), SECONDS, False, None)


def _Differences(values: "pandas.Series", numbers: Any) -> Array:
    """Returns the differences from the first number, exact but for one rounding.

    Stamps have up to 19 digits, of which a float keeps 16.
    """
    if numbers.dtype.kind in "iu" or values.dtype.kind == "f":
        differences: Array = (numbers - numbers[0]).astype(float)
        return differences
    stamps = [Decimal(text) for text in values.astype(str).str.strip()]
    return np.array([float(stamp - stamps[0]) for stamp in stamps])


def _OfDates(values: "pandas.Series", place: str, lines: Indices) -> Times:
    """Returns the times of a column of dates that a file has as such."""
    is_bad = values.isna().to_numpy()
    if is_bad.any():
        RefuseCell(place, lines, values.astype(str), is_bad, "a date")
    seconds = (values - values.iloc[0]).dt.total_seconds().to_numpy(dtype=float)
    return Times(seconds, DATES, True, "")


def _OfIsoTexts(texts: "pandas.Series", place: str, lines: Indices) -> Times:
    import pandas

    matches = [_ISO.fullmatch(x) for x in texts]
    has_zone = [match is not None and match[3] is not None for match in matches]
    is_bad = np.array([match is None for match in matches])
    is_bad |= np.array(has_zone) != has_zone[0]
    if not is_bad.any():
        clean = texts.str.replace("/", "-").str.replace(",", ".")
        clean = clean.str.replace(" ?UTC$", "Z", regex=True)
        clean = clean.str.replace(r"\s(?=Z$|[+-]\d\d(:?\d\d)?$)", "", regex=True)
        dates = pandas.to_datetime(clean, format="ISO8601", utc=True, errors="coerce")
        is_bad = dates.isna().to_numpy()
    if is_bad.any():
        zone = "with" if has_zone[0] else "without"
        RefuseCell(
            place, lines, texts, is_bad, f"ISO 8601 {zone} a zone, as in the first row"
        )
    return _OfDates(dates, place, lines)


def _OfTimesOfDay(texts: "pandas.Series", place: str, lines: Indices) -> Times:
    """Returns the times of a clock that begins again at midnight."""
    matches = [_TIME_OF_DAY.fullmatch(x) for x in texts]
    seconds = np.array([_SecondsOfDay(match) for match in matches])
    is_bad = np.isnan(seconds)
    if is_bad.any():
        RefuseCell(place, lines, texts, is_bad, "a time of day, 00:00:00 to 23:59:59")
    # A step back by more than half a day is midnight.
    midnights = np.cumsum(np.diff(seconds) < -LENGTH_OF_DAY / 2)
    days = np.concatenate([[0], midnights]) * LENGTH_OF_DAY
    return Times(seconds - seconds[0] + days, DAY, True, "")


def _SecondsOfDay(match: re.Match[str] | None) -> float:
    if match is None:
        return np.nan
    hours = int(match[1])
    minutes = int(match[2])
    seconds = float(match[3].replace(",", "."))
    if match[4] is not None:
        if not 1 <= hours <= 12:
            return np.nan
        hours = hours % 12 + 12 * (match[4].lower() == "p")
    is_allowed = hours < 24 and minutes < 60 and seconds < 61
    return hours * 3600.0 + minutes * 60.0 + seconds if is_allowed else np.nan


def IsTimeUnit(unit: str) -> bool:
    """Returns whether a unit is known and is one of times."""
    return unit in UNITS and UNITS[unit].quantity == "time"


def CheckTimeUnit(place: str, unit: str, where: str = "") -> None:
    """Refuses a unit that is not one of times.

    Args:
        place: The file and the column, for messages.
        where: The end of the message: where the unit must stand.
    """
    if not IsTimeUnit(unit):
        raise ScenarioError(
            f"{place}: unit {Show(unit)}: must be one of s, ms, us, ns{where}"
        )


def RefuseCell(
    place: str, lines: Indices, texts: Any, is_bad: Flags, allowed: str
) -> None:
    """Refuses the first bad cell of a column, if there is one."""
    for i in np.flatnonzero(is_bad)[:1]:
        cell = str(texts.iloc[int(i)])
        raise ScenarioError(
            f"{place}: line {lines[i]}, {Show(cell)}: must be {allowed}"
        )
