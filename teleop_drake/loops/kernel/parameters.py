"""The numbers of a kernel as numeric parameters of a block's Context.

Each parameter of a kernel is a number, an array, or a (named) tuple of numbers and
arrays. A block lists in `numeric_parameters` the parameters that a user may change,
each with its unit and range. Each of these becomes one numeric parameter of Drake, in
the order of the list: a vector with the elements of the array, row by row. All other
parameters are constants, or are computed from these.

Values that are not allowed are refused wherever the numbers of a Context are used: in
either engine, in Drake's plain Simulator, in pages and in linear models.
"""

import functools
import weakref
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector_,
    Context,
    LeafSystem_,
    ValueProducer,
)

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Range, Within
from teleop_drake.loops.jit.compiled import CompiledLaw
from teleop_drake.loops.kernel.events import Weakly
from teleop_drake.loops.kernel.kernel import Kernel


class NamedParameter(NamedTuple):
    """A numeric parameter of a block.

    Attributes:
        name: The name of a parameter of the kernel, or of a field of one.
        number: The index of the parameter in the block's Context.
        unit: The unit of its elements, empty for numbers without a unit.
        range: The values that they may have; None: any.
        shape: The shape of the array that the parameter holds.
    """

    name: str
    number: int
    unit: str
    range: Range | None
    shape: tuple[int, ...]


class Numbers:
    """The parameters of a kernel with their values in one Context.

    The object is immutable, so that a copy of a Context may share it.

    Attributes:
        values: The parameters by their names, with the types that the kernel uses.
    """

    def __init__(self, values: Mapping[str, Any]):
        self.values = values
        self._laws: dict[Any, Callable[..., Any]] = {}

    def __deepcopy__(self, memo: dict[int, Any]) -> "Numbers":
        return self

    def Bound(
        self, law: Callable[..., Any], names: tuple[str, ...], is_compiled: bool
    ) -> Callable[..., Any]:
        """Returns a law, or its machine code, with parameters as first arguments."""
        key = id(law), names  # A law may have no hash.
        if key not in self._laws:
            constants = [self.values[name] for name in names]
            bind = CompiledLaw if is_compiled else functools.partial
            self._laws[key] = bind(law, *constants)
        return self._laws[key]


class BlockParameters:
    """Declares the numeric parameters of a block, and reads them from its Context.

    Args:
        block: A LeafSystem of float or of AutoDiffXd.
        kernel: The block's kernel, with the default values.
        ranges: The range, or only the unit, of each number that becomes a numeric
            parameter, by the name of a parameter of the kernel, or of a field of a
            named tuple among them.

    Attributes:
        named: The numeric parameters, in the order of their numbers.
        ticket: The prerequisite of every value that depends on a parameter.
    """

    def __init__(self, block: Any, kernel: Kernel, ranges: Mapping[str, Range | str]):
        self._kernel = kernel
        self._last = Numbers(kernel.parameters)
        self._last_key: tuple[bytes, ...] | None = None
        scalar = AutoDiffXd if isinstance(block, LeafSystem_[AutoDiffXd]) else float
        leaves = _Leaves(kernel.parameters)
        self.named: list[NamedParameter] = []
        for name, range_or_unit in ranges.items():
            leaf = np.asarray(leaves[name])
            default = BasicVector_[scalar](leaf.ravel())
            number = int(block.DeclareNumericParameter(default))
            own = range_or_unit if isinstance(range_or_unit, Range) else None
            unit = str(range_or_unit) if own is None else own.unit
            self.named.append(NamedParameter(name, number, unit, own, leaf.shape))
        self.ticket = block.all_parameters_ticket()
        # A reference to the entry would keep the block alive, unknown to the garbage
        # collector; its index does not.
        self._block = weakref.ref(block)
        self._index = block.DeclareCacheEntry(
            "numbers of the kernel",
            ValueProducer(
                allocate=lambda: AbstractValue.Make(Numbers({})),
                calc=Weakly(self._CalcNumbers),
            ),
            {self.ticket},
        ).cache_index()

    def Check(self, context: Context, path: str) -> None:
        """Refuses values of a Context that are not allowed.

        Args:
            path: The path of the block, for messages.

        Raises:
            ScenarioError: Naming the parameter, its value and what is allowed.
        """
        arrays = {x.name: _ArrayIn(context, x) for x in self.named}
        self._CheckValues(arrays, path)

    def In(self, context: Context) -> Numbers:
        """Returns the parameters of the kernel with their values in a Context.

        Raises:
            ScenarioError: If a value is not allowed, see Check().
        """
        block = self._block()
        assert block is not None
        entry = block.get_cache_entry(self._index)
        return entry.EvalAbstract(context).get_value()

    def _CalcNumbers(self, context: Context, result: AbstractValue) -> None:
        """Computes the cache entry; equal values share the laws compiled for them.

        Drake calls this again whenever all parameters are copied from another Context.
        """
        arrays = {x.name: _ArrayIn(context, x) for x in self.named}
        if any(array.dtype == object for array in arrays.values()):
            # Values with derivatives are new each time and share no compiled law.
            result.set_value(self._With(arrays))
            return
        key = tuple(array.tobytes() for array in arrays.values())
        if key != self._last_key:
            self._last = self._CheckValues(arrays)
            self._last_key = key
        result.set_value(self._last)

    def _CheckValues(
        self, arrays: Mapping[str, Array], path: str | None = None
    ) -> Numbers:
        """Returns the kernel's parameters with arrays whose values are allowed."""
        block = self._block()
        assert block is not None
        place = block.get_name() if path is None else path
        prefix = f"{place}." if place else ""
        for parameter in self.named:
            if parameter.range is not None:
                array = arrays[parameter.name]
                parameter.range.Check(f"{prefix}{parameter.name}", array)
        numbers = self._With(arrays)
        with Within(place) if place else nullcontext():
            block.CheckParameters(numbers.values)
        return numbers

    def _With(self, arrays: Mapping[str, Array]) -> Numbers:
        """Returns the kernel's parameters with some arrays replaced."""
        parameters = _Filled(self._kernel.parameters, arrays)
        return Numbers(replace(self._kernel, parameters=parameters).parameters)


def _ArrayIn(context: Any, parameter: NamedParameter) -> Array:
    """Returns the array that a numeric parameter holds.

    In a Context of AutoDiffXd the array holds plain numbers unless one of them has
    derivatives.
    """
    vector = context.get_numeric_parameter(parameter.number).CopyToVector()
    if vector.dtype == object and not any(x.derivatives().size for x in vector):
        vector = ExtractValue(vector).ravel()
    return vector.reshape(parameter.shape)


def _Leaves(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Returns every parameter, or every field of one that has fields, by its name."""
    leaves: dict[str, Any] = {}
    for name, value in parameters.items():
        leaves |= value._asdict() if hasattr(value, "_asdict") else {name: value}
    return leaves


def _Filled(
    parameters: Mapping[str, Any], arrays: Mapping[str, Array]
) -> dict[str, Any]:
    """Returns parameters in which the arrays of some names are replaced."""
    numbers = {name: x if x.ndim else x.item() for name, x in arrays.items()}
    filled = {}
    for name, value in parameters.items():
        fields = numbers.keys() & getattr(value, "_fields", ())
        changes = {key: numbers[key] for key in fields}
        filled[name] = value._replace(**changes) if fields else numbers.get(name, value)
    return filled
