"""Stamps that stand in two columns: whole seconds, and the nanoseconds of them."""

from typing import TYPE_CHECKING

from teleop_drake.model.tables.headers import UNITS, ParseHeader

if TYPE_CHECKING:
    import pandas

_PER_SECOND = 10**9


def JoinStamps(frame: "pandas.DataFrame") -> tuple["pandas.DataFrame", dict[str, str]]:
    """Returns a table in which split stamps are one column, and the units of these.

    ROS writes `header.stamp.sec` and `header.stamp.nanosec`, which become the column
    `header.stamp` in ns.
    """
    import pandas

    headers = {str(name): ParseHeader(str(name)) for name in frame.columns}
    units: dict[str, str] = {}
    for name, (words, unit) in headers.items():
        if not _Has(unit, 1.0):
            continue
        rest = [x for x, (y, z) in headers.items() if y == words and _Has(z, 1e-9)]
        joined = ".".join(words)
        if len(rest) != 1 or joined in frame.columns:
            continue
        parts = [
            pandas.to_numeric(frame[column], errors="coerce")
            for column in (name, rest[0])
        ]
        if all(pandas.api.types.is_integer_dtype(part.dtype) for part in parts):
            stamps = parts[0].astype("int64") * _PER_SECOND + parts[1].astype("int64")
            frame = frame.rename(columns={name: joined}).drop(columns=rest)
            frame[joined] = stamps
            units[joined] = "ns"
    return _JoinDates(frame), units


def _JoinDates(frame: "pandas.DataFrame") -> "pandas.DataFrame":
    """Joins a column of dates and one of times of day."""
    dates = [x for x in frame.columns if ParseHeader(str(x)).key == "date"]
    times = [x for x in frame.columns if ParseHeader(str(x)).key == "time"]
    if len(dates) != 1 or len(times) != 1:
        return frame
    date = frame[dates[0]].astype(str).str.strip()
    time = frame[times[0]].astype(str).str.strip()
    is_day = date.str.fullmatch(r"\d{4}[-/]\d\d[-/]\d\d").all()
    if not is_day or not time.str.match(r"\d\d:\d\d").all():
        return frame
    frame = frame.drop(columns=dates)
    frame[times[0]] = date + "T" + time
    return frame


def _Has(unit: str, factor: float) -> bool:
    return unit in UNITS and UNITS[unit] == ("time", factor)
