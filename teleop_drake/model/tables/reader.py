"""Reads a table from a file of any kind that people have.

| file | read by |
|---|---|
| text: CSV, TSV, `;` with decimal commas, blanks, comments | pandas, after text.py |
| JSON: a list of records, records line by line | pandas |
| .xlsx, .xls, .ods | pandas, with openpyxl, xlrd or odfpy |
| .parquet | pandas, with pyarrow |
| .mat | SciPy; those of version 7.3 as HDF5 |
| .h5, .hdf5, .npz | h5py, NumPy |

pandas is imported where a file is read, because its import takes half a second.
"""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from teleop_drake.loops.framework.files import ReadBytes, ReadStart, Unzipped
from teleop_drake.loops.framework.validation import ScenarioError, Show
from teleop_drake.model.tables.arrays_of_files import ReadArrays
from teleop_drake.model.tables.headers import UNITS, ParseHeader
from teleop_drake.model.tables.split_stamps import JoinStamps
from teleop_drake.model.tables.table import Table
from teleop_drake.model.tables.text import SplitText

if TYPE_CHECKING:
    import pandas

# The package that pandas needs for a kind of file.
_NEEDS = {
    ".xlsx": "openpyxl",
    ".xlsm": "openpyxl",
    ".xls": "xlrd",
    ".ods": "odfpy",
    ".parquet": "pyarrow",
}

# Files of named arrays.
_ARRAYS = (".mat", ".h5", ".hdf5", ".npz")


def IsBinary(file: str) -> bool:
    """Returns whether a file's suffix is that of a format that is no text."""
    return Path(file).suffix.lower() in (*_NEEDS, *_ARRAYS)


def ReadTable(path: str, file: str) -> Table:
    """Reads a table from a file.

    Args:
        path: The field or option that names the file, for messages.
        file: The file; see the table of this module.

    Returns:
        The table, whose cells are not converted yet; see Table.Values().

    Raises:
        ScenarioError: If the file cannot be read, or has no rows.
    """
    origin = f"{path} = {Show(file)}"
    suffix = Path(file).suffix.lower()
    if IsBinary(file):
        ReadStart(file, origin, 1)  # The messages of other packages are longer.
    if suffix in _NEEDS:
        return OfFrame(_ReadFrame(file, suffix, origin), origin)
    if suffix in _ARRAYS:
        return OfRecords(ReadArrays(file, suffix, origin), origin)
    return TableOfText(ReadAnyText(file, origin), origin)


def TableOfText(text: str, origin: str) -> Table:
    """Returns the table of a text, or of JSON."""
    records = ParseJson(text)
    if records is not None:
        return OfRecords(records, origin)
    return OfText(text, origin)


def ReadAnyText(file: str, origin: str) -> str:
    """Returns the text of a file in UTF-8, UTF-16 or Windows' code page.

    Windows PowerShell writes what a command prints in UTF-16. irtt compresses its JSON.

    Raises:
        ScenarioError: If the file cannot be read, or is too long, or is no text.
    """
    data = ReadBytes(file, origin)
    if data[:2] == b"\x1f\x8b":
        data = Unzipped(data, origin)
    is_wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if is_wide else ("utf-8-sig", "cp1252", "latin-1"):
        try:
            text = data.decode(encoding)
        except UnicodeError:
            continue
        if "\0" not in text:
            return text
        break
    raise ScenarioError(f"{origin}: must be text, or have the suffix of its format")


def ParseJson(text: str) -> Any:
    """Returns the contents of JSON, or of lines of JSON; None if a text is neither."""
    start = text.lstrip()[:1]
    if start not in ("{", "["):
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    try:
        return [json.loads(line) for line in text.splitlines() if line.strip()]
    except (ValueError, RecursionError):
        return None


def OfText(text: str, origin: str) -> Table:
    """Returns the table of a text."""
    import pandas

    cells = SplitText(text, origin)
    names = cells.header or [str(i + 1) for i in range(len(cells.rows[0]))]
    names = [name or str(i + 1) for i, name in enumerate(names)]
    _CheckNames(names, origin)
    frame = pandas.DataFrame(cells.rows, columns=names, dtype=object)
    frame, joined = JoinStamps(frame)
    units = {names[i]: unit for i, unit in cells.units.items()} | joined
    for name, unit in units.items():
        named = ParseHeader(name).unit
        if named and UNITS.get(named) != UNITS[unit]:
            raise ScenarioError(
                f"{origin}: column {name!r}: must have one unit, not {named} and {unit}"
            )
    return Table(
        origin=origin,
        frame=frame,
        lines=np.array(cells.lines),
        has_header=bool(cells.header),
        comments=cells.comments,
        units=units,
    )


def OfRecords(records: Any, origin: str) -> Table:
    """Returns the table of records: a list of mappings, or a mapping of lists.

    Raises:
        ScenarioError: If they are neither, or there are none.
    """
    import pandas

    try:
        if isinstance(records, dict):
            frame = pandas.DataFrame(records)
        else:
            frame = pandas.json_normalize(records)
    # pandas raises any of these for JSON that is no table.
    except (
        AttributeError,
        NotImplementedError,
        OverflowError,
        TypeError,
        ValueError,
    ):
        frame = pandas.DataFrame()
    if frame.empty:
        raise ScenarioError(
            f"{origin}: must be a list of records, or named lists of one length"
        )
    return OfFrame(frame, origin)


def OfFrame(frame: "pandas.DataFrame", origin: str) -> Table:
    """Returns the table of a DataFrame; a column of vectors becomes several columns.

    Raises:
        ScenarioError: If there is no row or column, or a name stands twice.
    """
    import pandas

    if frame.empty:
        raise ScenarioError(f"{origin}: must have rows, and has none")
    if any(name is not None for name in frame.index.names):
        frame = frame.reset_index()
    columns: dict[str, Any] = {}
    names: list[str] = []
    for name, cells in frame.items():
        parts = _Vectors(cells)
        for i, part in enumerate(parts):
            names.append(f"{name}_{i}" if len(parts) > 1 else str(name))
            columns[names[-1]] = part
    if not names:
        raise ScenarioError(f"{origin}: must have columns, and its rows are empty")
    _CheckNames(names, origin)
    whole = pandas.DataFrame(columns).reset_index(drop=True).infer_objects()
    joined, units = JoinStamps(whole)
    for name in joined.select_dtypes("timedelta"):
        joined[name] = joined[name].dt.total_seconds()
        units[name] = "s"
    return Table(
        origin=origin,
        frame=joined,
        lines=np.arange(len(frame)) + 1,
        has_header=True,
        units=units,
    )


def _Vectors(cells: "pandas.Series") -> list[Any]:
    """Returns the components of a column of vectors, or the column itself."""
    first = cells.iloc[0]
    if not isinstance(first, (list, tuple, np.ndarray)):
        return [cells]
    try:
        table = np.array([np.asarray(x, dtype=float).ravel() for x in cells])
    except (TypeError, ValueError):
        return [cells]
    return list(table.T)


def _CheckNames(names: Sequence[str], origin: str) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise ScenarioError(
                f"{origin}: column {name!r}: must be named once, not {count} times"
            )


def _ReadFrame(file: str, suffix: str, origin: str) -> "pandas.DataFrame":
    """Returns the contents of a file that pandas reads with a further package."""
    import pandas

    try:
        if suffix == ".parquet":
            return pandas.read_parquet(file)
        sheets = pandas.read_excel(file, sheet_name=None)
    except ImportError:
        raise ScenarioError(
            f"{origin}: must have a package that reads it: pip install {_NEEDS[suffix]}"
        ) from None
    # What these packages raise for a file that is damaged differs from one to another.
    except Exception as error:  # noqa: BLE001
        text = " ".join(str(error).split())
        raise ScenarioError(f"{origin}: must be a {suffix} file ({text})") from None
    full = [name for name, sheet in sheets.items() if not sheet.empty]
    if len(full) > 1:
        names = ", ".join(map(Show, full))
        raise ScenarioError(f"{origin}: must have one sheet with rows, not {names}")
    return sheets[full[0]] if full else next(iter(sheets.values()))
