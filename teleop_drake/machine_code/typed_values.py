"""The types and values of what typed_code compiles."""

import struct
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

FLOAT, INTEGER, BOOLEAN, NOTHING = "double", "i64", "i1", "void"


class ArrayType(NamedTuple):
    """An array: a pointer, and its dimensions one after another.

    Attributes:
        item: Type of the elements.
        num_dimensions: Number of indices.
    """

    item: str
    num_dimensions: int


class TupleType(NamedTuple):
    """A named tuple: a pointer to eight bytes for each number in its arrays' headers.

    Attributes:
        fields: Names and types.
    """

    fields: tuple[tuple[str, Any], ...]


EVALUATE = "evaluate"
"""The type of a function `evaluate` as scalar_code makes it."""

Type = Any


class NotTyped(Exception):
    """A function that is outside of the part of Python that is compiled here."""


@dataclass(frozen=True)
class Value:
    """What an expression is.

    Attributes:
        type: Its type.
        operands: What LLVM calls it; of an array the pointer and the dimensions.
    """

    type: Type
    operands: tuple[str, ...]


def TypeOf(value: Any) -> Type:
    """Returns the type of an argument."""
    if isinstance(value, bool):
        return BOOLEAN
    if isinstance(value, (int, np.integer)):
        return INTEGER
    if isinstance(value, (float, np.floating)):
        return FLOAT
    if isinstance(value, np.ndarray):
        assert value.flags.c_contiguous and value.dtype.itemsize == 8, value.dtype
        item = FLOAT if value.dtype.kind == "f" else INTEGER
        return ArrayType(item, value.ndim)
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        items = zip(value._fields, value, strict=True)
        return TupleType(tuple((name, TypeOf(item)) for name, item in items))
    return EVALUATE


def Header(value: Any) -> list[int]:
    """Returns what is in memory of a named tuple: addresses and dimensions."""
    if isinstance(value, np.ndarray):
        return [value.ctypes.data, *value.shape]
    if isinstance(value, (int, np.integer)):
        return [int(value)]
    return [number for item in value for number in Header(item)]


def ConstantText(value: Any) -> str:
    """Returns a number in LLVM's language."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    return "0x" + struct.pack(">d", value).hex().upper()


def PartsOf(kind: Type) -> tuple[str, ...]:
    """Returns the types of the operands of a value."""
    if isinstance(kind, ArrayType):
        return ("ptr", *("i64" for _ in range(kind.num_dimensions)))
    if isinstance(kind, TupleType) or kind == EVALUATE:
        return ("ptr",)
    return (kind,)


def NumSlots(kind: Type) -> int:
    """Returns how many numbers a type has in a Header()."""
    if isinstance(kind, TupleType):
        return sum(NumSlots(inner) for _, inner in kind.fields)
    return len(PartsOf(kind))
