"""Type aliases for annotations."""

from typing import TYPE_CHECKING, Any, NewType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

Record = dict[str, Any]
"""Values, keyed by name."""

Names = tuple[str, ...]

Interval = tuple[float, float]
"""The lower and the upper bound of an interval."""

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike
else:
    # NumPy's ArrayLike is a union, which help() would print in every signature.
    ArrayLike = NewType("ArrayLike", object)
