"""Checks of input and their messages, for every part of the package.

To refuse a value is to raise a ScenarioError. Its message is one line: the field, its
value and what is allowed.
"""

import contextlib
import functools
import math
import reprlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields
from types import UnionType
from typing import Any, NoReturn, SupportsFloat, TypeVar, dataclass_transform, get_args

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array, Record

# Stands for a value that is missing. Every config can be constructed without arguments;
# its checks refuse required fields that are missing.
REQUIRED: Any = None

_T = TypeVar("_T")


class ScenarioError(ValueError):
    """Bad input. Its text is one line: the field, its value and what is allowed."""


class WrongKind(ScenarioError, TypeError):
    """An argument that is not of a class that a function takes."""


def Number(
    default: float | None,
    unit: str = "",
    *,
    above: float = -math.inf,
    minimum: float = -math.inf,
    maximum: float = math.inf,
) -> Any:
    """Returns a field for a number with the bounds of CheckNumber; see FixedFields."""
    bounds = {"above": above, "minimum": minimum, "maximum": maximum}
    return field(default=default, metadata={_NUMBER: {"unit": unit, **bounds}})


def GainField(default: float | None, *, may_be_zero: bool = False) -> Any:
    """Returns a field for a gain, as CheckGain() allows it; see FixedFields."""
    return field(default=default, metadata={_GAIN: {"may_be_zero": may_be_zero}})


Gains = np.ndarray | float
"""The type of a gain: a matrix (n, n), or a number x that stands for x times I."""

_NUMBER = "number"
_GAIN = "gain"


@dataclass_transform(kw_only_default=True, eq_default=False, field_specifiers=(field,))
def Config(kind: type[_T]) -> type[_T]:
    """Makes a config: a keyword-only dataclass that is compared by identity."""
    return dataclass(kw_only=True, eq=False)(kind)


class FixedFields:
    """Base of config dataclasses, in which only declared fields can be set.

    Any other field would have no effect. Names that begin with an underscore are
    allowed.
    """

    def CheckNumbers(self, path: str = "") -> None:
        """Checks every field of Number(); null is allowed if its type has None."""
        for name, limits in self._Limits(_NUMBER).items():
            place = f"{path}.{name}" if path else name
            CheckNumber(place, getattr(self, name), **limits)

    def CheckGains(self, path: str, num_axes: int) -> None:
        """Checks every field of GainField(); null is allowed if its type has None."""
        for name, limits in self._Limits(_GAIN).items():
            CheckGain(f"{path}.{name}", getattr(self, name), num_axes, **limits)

    def MakeMatrices(self, num_axes: int) -> None:
        """Converts the fields of GainField() to matrices (n, n), except for null."""
        for name in self._Limits(_GAIN):
            value = getattr(self, name)
            if value is not None:
                setattr(self, name, GainMatrix(value, num_axes))

    def Gain(self, name: str, num_axes: int) -> Array:
        """Returns a field of GainField() as a matrix (n, n); refuses null."""
        limits = {**self._Limits(_GAIN)[name], "may_be_null": False}
        return CheckGain(name, getattr(self, name), num_axes, **limits)

    @classmethod
    @functools.cache
    def _Limits(cls, sort: str) -> dict[str, Record]:
        """Returns the limits of the fields of a sort (_NUMBER or _GAIN), by name.

        A subclass that gives a field another default inherits the limits.
        """
        return {
            item.name: {
                **item.metadata[sort],
                "may_be_null": type(None) in get_args(item.type),
            }
            for base in reversed(cls.__mro__)
            for item in getattr(base, "__dataclass_fields__", {}).values()
            if sort in item.metadata
        }

    def __setattr__(self, name: str, value: Any) -> None:
        """Sets a field, or raises an AttributeError if there is no such field."""
        if not name.startswith("_") and not hasattr(type(self), name):
            known = [x.name for x in fields(self) if x.init]  # type: ignore[arg-type]
            if name not in known:
                raise AttributeError(
                    f"{name} = {Show(value)}: {type(self).__name__} has no such field, "
                    f"must be {Choices(name, known)}"
                )
        super().__setattr__(name, value)


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60


def Show(value: Any) -> str:
    """Returns the value as YAML would write it, on one short line."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size:
        value = np.vectorize(lambda x: float(f"{x:.6g}"), otypes=[float])(value)
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    return _SHORT.repr(value)


def IsGiven(value: object) -> bool:
    """Returns whether a value is given: not null in YAML and not left at REQUIRED."""
    return value is not None


def Refuse(path: str, value: Any, allowed: str) -> NoReturn:
    """Raises a ScenarioError with the text `path = value: must be allowed`."""
    raise ScenarioError(f"{path} = {Show(value)}: must be {allowed}")


def CheckKind(
    path: str, value: Any, kinds: type[Any] | UnionType, allowed: str
) -> None:
    """Refuses a value that is not of one of some classes.

    Args:
        path: The name of the argument.
        allowed: What the argument may be and, for a value that a sister function takes,
            the name of this function.

    Raises:
        WrongKind: If the value is of another class.
    """
    if isinstance(value, kinds):
        return
    is_plain = value is None or isinstance(value, str | int | float)
    shown = Show(value) if is_plain else f"a {type(value).__name__}"
    raise WrongKind(f"{path} = {shown}: must be {allowed}")


@contextlib.contextmanager
def Within(path: str) -> Iterator[None]:
    """Prefixes the path of a config to fields that are refused in the context."""
    try:
        yield
    except ScenarioError as e:
        raise ScenarioError(f"{path}.{e}") from None


def RefuseGiven(allowed: str, **arguments: Any) -> None:
    """Refuses the arguments that are given, which are neither None nor False."""
    given = [name for name, x in arguments.items() if x is not None and x is not False]
    if given:
        Refuse(", ".join(given), "given", allowed)


def Choices(value: Any, choices: Iterable[str]) -> str:
    """Returns "one of a, b (did you mean 'a'?)"."""
    import difflib  # Imported here because it is seldom needed.

    choices = list(choices)
    text = "one of " + ", ".join(choices)
    nearest = difflib.get_close_matches(str(value), choices, n=1, cutoff=0.5)
    return f"{text} (did you mean {nearest[0]!r}?)" if nearest else text


def CheckChoice(path: str, value: Any, choices: Iterable[str]) -> None:
    """Refuses a value that is none of the choices."""
    choices = list(choices)
    if value not in choices:
        Refuse(path, value, Choices(value, choices))


def CheckNames(path: str, value: Any) -> None:
    """Refuses a text where a list of names is required."""
    if isinstance(value, str):
        Refuse(path, value, f"a list of names: [{value!r}]")


def CheckNumber(
    path: str,
    value: Any,
    unit: str = "",
    *,
    above: float = -math.inf,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    may_be_null: bool = False,
) -> None:
    """Refuses a number that is missing (None), not finite or out of bounds.

    Args:
        unit: The unit, for the message.
        above: Lower bound, exclusive.
        minimum: Lower bound, inclusive.
        maximum: Upper bound, inclusive.
        may_be_null: Whether None is allowed.
    """
    if value is None and may_be_null:
        return
    # The first two are quick to tell.
    is_number = isinstance(value, float | int | SupportsFloat)
    is_finite = is_number and math.isfinite(value)
    if not is_finite or value <= above or not minimum <= value <= maximum:
        bounds = ((">", above), (">=", minimum), ("<=", maximum))
        shown = " and ".join(f"{sign} {x:g}" for sign, x in bounds if math.isfinite(x))
        allowed = ["a finite number", shown, f"({unit})" if unit else ""]
        Refuse(path, value, " ".join(filter(None, allowed)))


def CheckVector(path: str, value: Any, size: int, unit: str) -> None:
    """Refuses a value that is missing (None) or no vector of `size` finite numbers."""
    if value is None or np.shape(value) != (size,) or not np.all(np.isfinite(value)):
        entries = "1 finite number" if size == 1 else f"{size} finite numbers"
        Refuse(path, value, f"a list of {entries} ({unit})")


@dataclass(frozen=True)
class Range:
    """The unit of a number, or of an array of numbers, and the values that it may have.

    Attributes:
        unit: The SI unit; empty for numbers without a unit.
        above, minimum, maximum: The bounds, as for CheckNumber().
        is_matrix: Whether the array is a matrix, for which one number stands for the
            number times the identity.
    """

    unit: str = ""
    above: float = -math.inf
    minimum: float = -math.inf
    maximum: float = math.inf
    is_matrix: bool = False

    def Check(self, path: str, value: ArrayLike) -> None:
        """Refuses a number, or an array with an element, that is out of bounds."""
        array = np.asarray(value, dtype=float)
        for place in np.ndindex(array.shape):
            inside = f"({','.join(map(str, place))})" if array.size > 1 else ""
            CheckNumber(
                f"{path}{inside}",
                array[place].item(),
                self.unit,
                above=self.above,
                minimum=self.minimum,
                maximum=self.maximum,
            )

    def Of(self, place: tuple[int, ...]) -> "Range":
        """Returns the range of one element of an array, by its indices."""
        return self


@dataclass(frozen=True)
class GainRange(Range):
    """The unit of a gain, which is a matrix as CheckGain() allows it.

    Attributes:
        may_be_zero: Whether the matrix may be positive semidefinite; else it must be
            positive definite.
    """

    is_matrix: bool = True
    may_be_zero: bool = False

    def Check(self, path: str, value: ArrayLike) -> None:
        """Refuses a matrix that is not symmetric and positive (semi)definite."""
        CheckGain(path, value, len(np.atleast_1d(value)), may_be_zero=self.may_be_zero)


@dataclass(frozen=True)
class RangeOfEach(Range):
    """The ranges of an array whose elements have different ones.

    Attributes:
        elements: The range of each element.
    """

    elements: tuple[Range, ...] = ()

    def Check(self, path: str, value: ArrayLike) -> None:
        """Refuses an array with an element that is out of its bounds."""
        numbers = np.asarray(value, dtype=float).tolist()
        for i, (element, number) in enumerate(zip(self.elements, numbers, strict=True)):
            element.Check(f"{path}({i})", number)

    def Of(self, place: tuple[int, ...]) -> Range:
        """Returns the range of one element."""
        return self.elements[place[0]]


def GainMatrix(gain: ArrayLike, num_axes: int) -> Array:
    """Returns a gain as an n x n matrix; a number x means x times the identity."""
    matrix = np.asarray(gain, dtype=float)
    return np.diag(np.full(num_axes, matrix)) if matrix.ndim == 0 else matrix


def CheckGain(
    path: str,
    value: Any,
    num_axes: int,
    *,
    may_be_zero: bool = False,
    may_be_null: bool = False,
) -> Array:
    """Checks a gain, a number or a symmetric matrix, and returns it as a matrix (n, n).

    Args:
        may_be_zero: Whether the matrix may be positive semidefinite; else it must be
            positive definite.
        may_be_null: Whether None is allowed, for which zeros are returned.
    """
    n = num_axes
    if value is None and may_be_null:
        return np.zeros((n, n))
    matrix = GainMatrix(np.nan if value is None else value, n)
    is_symmetric = (
        matrix.shape == (n, n)
        and np.isfinite(matrix).all()
        and (np.abs(matrix - matrix.T) <= 1e-12 * np.abs(matrix)).all()
    )
    least = np.linalg.eigvalsh(matrix)[0] if is_symmetric else -math.inf
    if least > 0 or (may_be_zero and least == 0):
        return matrix
    sign, kind = ("not negative", "semi") if may_be_zero else ("positive", "")
    matrix_kind = f"symmetric positive {kind}definite {n} x {n} matrix"
    Refuse(path, value, f"{'null, ' * may_be_null}{sign}, or a {matrix_kind}")
