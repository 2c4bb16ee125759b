"""The types of arrays, for annotations."""

from typing import TYPE_CHECKING, NewType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Indices = NDArray[np.int64]

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike
else:
    # NumPy's is a union that help() writes out in every signature.
    ArrayLike = NewType("ArrayLike", object)
