"""Numbers and arrays in LLVM's code, whose operations in Python write instructions.

typed_code translates the statements.
"""

from abc import abstractmethod
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.loops.jit.scalar_code import (
    BOOLEAN,
    FLOAT,
    INTEGER,
    NOTHING,
    CodeWriter,
    ConstantText,
    Instruction,
)
from teleop_drake.loops.jit.symbols import COMPARISONS, Symbol

EVALUATE = "evaluate"
"""The type of a function `evaluate` as scalar_code makes it."""


class ArrayType(NamedTuple):
    """An array: a pointer to its items, and its dimensions."""

    item: str
    num_dimensions: int


class TupleType(NamedTuple):
    """A named tuple: a pointer to its header, with eight bytes for each number.

    Attributes:
        fields: The names and types of the fields.
    """

    fields: tuple[tuple[str, Any], ...]


Type = Any


def TypeOf(value: Any) -> Type:
    """Returns the type of an argument; None has its own."""
    if isinstance(value, Value):
        return value._kind
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return BOOLEAN
    if isinstance(value, (int, np.integer)):
        return INTEGER
    if isinstance(value, (float, np.floating)):
        return FLOAT
    if isinstance(value, np.ndarray):
        assert value.flags.c_contiguous and value.dtype.itemsize == 8, value.dtype
        return ArrayType(FLOAT if value.dtype.kind == "f" else INTEGER, value.ndim)
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return TupleType(tuple(zip(value._fields, map(TypeOf, value), strict=True)))
    return EVALUATE


def TextOf(kind: Type) -> str:
    """Returns a type in LLVM's language."""
    if isinstance(kind, ArrayType):
        return f"{{{', '.join(['ptr', *[INTEGER] * kind.num_dimensions])}}}"
    return "ptr" if isinstance(kind, TupleType) or kind == EVALUATE else kind


def _NumSlots(kind: Type) -> int:
    """Returns how many numbers a type has in the header of a named tuple."""
    if isinstance(kind, TupleType):
        return sum(_NumSlots(inner) for _, inner in kind.fields)
    if kind == NOTHING:
        return 0
    return 1 + kind.num_dimensions if isinstance(kind, ArrayType) else 1


class Value(Symbol):
    """A number, an array, a named tuple or a function `evaluate` in LLVM's code.

    The fields of a named tuple are attributes of its Value. The names of the Value's
    own attributes therefore begin with an underscore, as those of fields cannot.

    Args:
        code: The writer of the function to which the Value belongs.
        kind: The type of the Value.
        operand: The name of the Value in LLVM's language, or a constant.
    """

    __slots__ = ("_code", "_kind", "_operand")

    def __init__(self, code: "ValueWriter", kind: Type, operand: str):
        self._code = code
        self._kind = kind
        self._operand = operand

    def __bool__(self) -> bool:
        raise TypeError("the truth of a number within an expression")

    def Operate(self, operation: str, *operands: Any) -> "Value":
        """Writes an operation on numbers; all are converted to floats if one is."""
        code = self._code
        values = [code.AsValue(operand) for operand in operands]
        is_float = any(value._kind == FLOAT for value in values)
        kind = FLOAT if is_float or operation in _OF_FLOATS else values[0]._kind
        texts = [code.As(kind, value) for value in values]
        if operation == "floordiv" and (kind, texts[1]) == (INTEGER, "2"):
            return Value(code, kind, code.Do(f"ashr i64 {texts[0]}, 1"))
        if operation not in _OF_NUMBERS or kind not in (FLOAT, INTEGER):
            raise TypeError(f"{operation} of {kind}")
        result = BOOLEAN if operation in COMPARISONS else kind
        return Value(code, result, code.Do(Instruction(operation, kind, texts)))

    def __getattr__(self, name: str) -> "Value | None":
        """Returns a field of a named tuple; None if its type is that of None."""
        place = 0
        for field, kind in getattr(self._kind, "fields", ()):
            if field == name and kind == NOTHING:
                return None
            if field == name:
                return self._code.Field(kind, self._operand, place)
            place += _NumSlots(kind)
        raise TypeError(f"the attribute {name}")

    def __getitem__(self, key: Any) -> "Value":
        """Returns an element of an array, or a part with fewer dimensions."""
        code = self._code
        pointer, rest = self._At(key)
        if not rest:
            return code.Load(self._kind.item, pointer)
        return code.Array(ArrayType(self._kind.item, len(rest)), pointer, *rest)

    def __setitem__(self, key: Any, value: Any) -> None:
        """Writes an element of an array."""
        pointer, rest = self._At(key)
        if rest:
            raise TypeError("it writes a whole array")
        kind = self._kind.item
        self._code.Store(kind, self._code.As(kind, value), pointer)

    def Part(self, k: int) -> str:
        """Returns the pointer of an array (k = 0), or its dimension k, from 1 on."""
        return self._code.Do(f"extractvalue {TextOf(self._kind)} {self._operand}, {k}")

    def _At(self, key: Any) -> tuple[str, list[str]]:
        """Returns the pointer to the item or part at an index, and its dimensions.

        The index has to be within the array. An index below 0 is out of bounds here.
        """
        code = self._code
        keys = key if isinstance(key, tuple) else (key,)
        num_dimensions = getattr(self._kind, "num_dimensions", 0)
        if len(keys) > num_dimensions:
            raise TypeError("more indices than the array has dimensions")
        dimensions = [self.Part(k + 1) for k in range(num_dimensions)]
        place = "0"
        for k, dimension in enumerate(dimensions):
            place = code.Do(f"mul nsw i64 {place}, {dimension}")
            if k < len(keys):
                index = code.As(INTEGER, keys[k])
                code.Demand(code.Do(f"icmp ult i64 {index}, {dimension}"))
                place = code.Do(f"add nsw i64 {place}, {index}")
        item = f"getelementptr {self._kind.item}, ptr {self.Part(0)}, i64 {place}"
        return code.Do(item), dimensions[len(keys) :]

    def __call__(self, t: "Value", *others: "Value") -> None:
        """Writes a call of `evaluate`, which takes pointers."""
        code = self._code
        *arrays, wanted = map(code.AsValue, others)
        pointers = ", ".join(f"ptr {array.Part(0)}" for array in arrays)
        what = code.Do(f"trunc i64 {code.As(INTEGER, wanted)} to i32")
        arguments = f"double {code.As(FLOAT, t)}, {pointers}, i32 {what}"
        code.lines.append(f"  call void {self._operand}({arguments})")


# Operations that convert all numbers to floats, and all operations on numbers.
_OF_FLOATS = frozenset({"div", "pow", "neg", "fabs"})
_OF_NUMBERS = COMPARISONS | _OF_FLOATS | {"add", "sub", "mul"}


class Variables(dict[str, tuple[Type, str]]):
    """The types of a function's variables, and their places in memory.

    Attributes:
        lines: The instructions that reserve the memory.
    """

    def __init__(self, code: "ValueWriter"):
        super().__init__()
        self.lines: list[str] = []
        self._code = code

    def __getitem__(self, name: str) -> Any:
        """Returns the current value of a variable."""
        return self._code.Load(*super().__getitem__(name))

    def __setitem__(self, name: str, value: Any) -> None:
        """Assigns to a variable, which keeps the type of its first value."""
        code = self._code
        kind = self.get(name, (TypeOf(value), ""))[0]
        text = TextOf(kind)
        if name not in self:
            slot = f"%{code.NewName()}"
            super().__setitem__(name, (kind, slot))
            self.lines.append(f"  {slot} = alloca {text}")
        code.Store(text, code.As(kind, value), super().__getitem__(name)[1])


class ValueWriter(CodeWriter):
    """Writes the instructions of Values."""

    @abstractmethod
    def Demand(self, condition: str) -> None:
        """Ends the function with an error unless a condition holds."""

    def AsValue(self, value: Any) -> Value:
        """Returns a value as a Value; a plain number becomes a constant."""
        if isinstance(value, Value):
            return value
        if not isinstance(value, (bool, int, float)):
            raise TypeError(f"a {type(value).__name__}")
        return Value(self, TypeOf(value), ConstantText(value))

    def As(self, kind: Type, value: Any) -> str:
        """Returns the operand of a number, converted to a type."""
        value = self.AsValue(value)
        if value._kind == kind:
            return str(value._operand)
        if (kind, value._kind) == (FLOAT, INTEGER):
            return self.Do(f"sitofp i64 {value._operand} to double")
        raise TypeError(f"a variable is {kind} and {value._kind}")

    def Array(self, kind: Type, pointer: str, *dimensions: str) -> Value:
        """Returns an array with a pointer and dimensions."""
        array = "poison"
        for k, part in enumerate([f"ptr {pointer}", *[f"i64 {x}" for x in dimensions]]):
            array = self.Do(f"insertvalue {TextOf(kind)} {array}, {part}, {k}")
        return Value(self, kind, array)

    def Load(self, kind: Type, pointer: str) -> Value:
        """Returns the value of a type at a place in memory."""
        return Value(self, kind, self.Do(f"load {TextOf(kind)}, ptr {pointer}"))

    def Field(self, kind: Type, header: str, place: int) -> Value:
        """Returns the field of a named tuple at a place in its header."""
        pointer = self.Do(f"getelementptr i64, ptr {header}, i64 {place}")
        if isinstance(kind, TupleType):
            return Value(self, kind, pointer)
        return self.Load(kind, pointer)
