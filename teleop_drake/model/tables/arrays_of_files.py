"""Files of named arrays: MATLAB, HDF5, NumPy."""

from collections.abc import Mapping
from typing import Any
from zipfile import BadZipFile

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import ScenarioError


def ReadArrays(file: str, suffix: str, origin: str) -> dict[str, Array]:
    """Returns columns (N,) by name from a file of named arrays.

    An array inside groups or structs is named by its path, `observations/qpos`. The
    columns of a matrix have numbers, `action_0`. Of arrays of different lengths, those
    of the length are read that most of them have.

    Raises:
        ScenarioError: If the file cannot be read, or a package is missing.
    """
    readers = {".mat": _ReadMatlab, ".npz": _ReadNumpy}
    try:
        arrays = readers.get(suffix, _ReadHdf5)(file)
    except ImportError:
        raise ScenarioError(
            f"{origin}: must have a package that reads it: pip install h5py"
        ) from None
    except (EOFError, KeyError, OSError, TypeError, ValueError, BadZipFile) as error:
        text = " ".join(str(error).split())
        raise ScenarioError(f"{origin}: must be a {suffix} file ({text})") from None
    columns = _Columns(arrays)
    if not columns:
        raise ScenarioError(f"{origin}: must have arrays of numbers, and has none")
    return columns


def _ReadMatlab(file: str) -> dict[str, Array]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        contents = loadmat(file, simplify_cells=True)
    except NotImplementedError:  # Version 7.3 is HDF5.
        return {name: x.T for name, x in _ReadHdf5(file).items()}
    except MatReadError as error:
        raise ValueError(error) from None
    own = {name: x for name, x in contents.items() if not name.startswith("__")}
    return _Leaves(own, "")


def _Leaves(contents: Mapping[str, Any], path: str) -> dict[str, Array]:
    """Returns the arrays of numbers in nested mappings, by their paths."""
    leaves: dict[str, Array] = {}
    for name, value in contents.items():
        if isinstance(value, Mapping):
            leaves |= _Leaves(value, f"{path}{name}/")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            leaves[path + name] = value
    return leaves


def _ReadNumpy(file: str) -> dict[str, Array]:
    with open(file, "rb") as stream:
        contents = np.load(stream, allow_pickle=False)
        if not isinstance(contents, Mapping):
            raise ValueError("it has one array without a name")
        return _Leaves({name: contents[name] for name in contents}, "")


def _ReadHdf5(file: str) -> dict[str, Array]:
    import h5py

    arrays: dict[str, Array] = {}

    def Visit(name: str, item: Any) -> None:
        if (
            isinstance(item, h5py.Dataset)
            and item.dtype.kind in "iuf"
            and item.ndim < 3
        ):
            arrays[name] = item[()]

    with h5py.File(file, "r") as contents:
        contents.visititems(Visit)
    return arrays


def _Columns(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Returns the columns of the arrays that have as many rows as most have."""
    tables = {}
    for name, array in arrays.items():
        is_vector = array.ndim == 1 or (array.ndim == 2 and 1 in array.shape)
        table = array.ravel() if is_vector else array
        if table.ndim in (1, 2) and len(table) > 1:
            tables[name] = table
    lengths = [len(array) for array in tables.values()]
    if not lengths:
        return {}
    most = max(lengths, key=lambda length: (lengths.count(length), length))
    columns = {}
    for name, array in tables.items():
        if len(array) != most:
            continue
        if array.ndim == 1:
            columns[name] = array
            continue
        columns |= {f"{name}_{i}": array[:, i] for i in range(array.shape[1])}
    return columns
