"""Names of types, for annotations."""

from typing import TYPE_CHECKING, Any, NewType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Indices = NDArray[np.int64]

Record = dict[str, Any]
"""Values by their names."""

Names = tuple[str, ...]

Interval = tuple[float, float]
"""Where something begins and where it ends."""

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike
else:
    # NumPy's is a union that help() writes out in every signature.
    ArrayLike = NewType("ArrayLike", object)
