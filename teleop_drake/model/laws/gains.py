"""The constants of a control law: their checks and their form for compiled code."""

import functools
from collections import namedtuple
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self, cast

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse


@dataclass(frozen=True, kw_only=True, eq=False)
class LawGains:
    """The constants of a law with n task axes: numbers and matrices (n, n).

    Matrices are copied and made read-only. The class of each law adds its own gains.

    Attributes:
        Lambda: Weight of one error relative to another (n, n).
        allowed_matrix: The condition on a matrix in an error message.

    Raises:
        ValueError: If a matrix is not finite or has another size than Lambda.
    """

    Lambda: Array
    allowed_matrix: ClassVar[str] = "a finite {n} x {n} matrix, the size of Lambda"

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.Lambda))
        for field in fields(self):
            if field.type is float:
                continue
            value = np.array(getattr(self, field.name), dtype=float)
            if value.shape != (n, n) or not np.isfinite(value).all():
                Refuse(field.name, value, self.allowed_matrix.format(n=n))
            value.setflags(write=False)
            object.__setattr__(self, field.name, value)

    @property
    def num_axes(self) -> int:
        """Number n of task axes."""
        return len(self.Lambda)

    def as_numbers(self) -> Self:
        """Returns the gains as a named tuple, which compiled code can read."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return cast(Self, _tuple_of(*values)(**values))


@functools.cache
def _tuple_of(*names: str) -> Any:
    """Returns the named tuple class with the given fields."""
    return namedtuple("Numbers", names)


def min_eigenvalue(matrix: Array) -> float:
    """Returns the smallest eigenvalue of a matrix's symmetric part."""
    return float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])
