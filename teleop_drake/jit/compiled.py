"""Laws and loops as machine code."""

import functools
import logging
import threading
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any, cast

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.jit.native import BoundEvaluate, Kept, Library
from teleop_drake.jit.scalar_code import IsWhole, MakeCode, TraceLaw
from teleop_drake.jit.symbols import Untraceable

Law = Callable[..., Array]

# A law is compiled at this call. To make a diagram or a linear model takes fewer calls,
# which do not pay for compilation.
_COMPILED_CALL = 200


_told: set[Any] = set()


def TellOnce(error: Untraceable) -> None:
    """Logs that a law is not compiled, once for each law."""
    if error.function not in _told:
        _told.add(error.function)
        logging.getLogger("teleop_drake").warning("not compiled: %s", error)


class CompiledLaw:
    """A law that becomes machine code after some calls as a Python function.

    Both compute the same function to within rounding. Each thread traces the law for
    itself. Values outside of its arguments are read then, and not again; a new
    CompiledLaw traces anew. A law that cannot be a graph of operations, see `tracing`,
    remains a Python function, and a line in the log has the reason.

    Args:
        law: A function of numbers and arrays that returns an array. The shapes are the
            same in each call.
        constants: The law's first arguments, which are the same in each call and may be
            named tuples. All whole numbers and arrays of them have to be among these,
            because they determine the structure of the graph.
    """

    def __init__(self, law: Law, *constants: Any):
        self.law = functools.partial(law, *constants)
        self._local = _Local()

    def __call__(self, *arguments: Any) -> Array:
        """Calls the law."""
        local = self._local
        if local.run is None:
            local.num_calls += 1
            if local.num_calls < _COMPILED_CALL:
                with np.errstate(all="ignore"):  # Machine code does not warn either.
                    return self.law(*arguments)
            local.run = self._Compiled(arguments)
        return local.run(*arguments)

    def _Compiled(self, arguments: Sequence[Any]) -> Law:
        """Returns the law as machine code, or the law itself, and logs the reason."""
        # A first call in Python gives the shape of the result.
        result = np.array(self.law(*arguments), dtype=float)
        samples = [*self.law.args, *(np.asarray(x, dtype=float) for x in arguments)]
        try:
            library = _LibraryOf(cast(FunctionType, self.law.func), samples)
        except Untraceable as error:
            error.function = self.law.func
            error.place = error.place or f"{self.law.func.__name__}()"
            TellOnce(error)
            return self.law
        leaves = [x for x in _LeavesOf(samples) if not IsWhole(x)]
        memory = np.concatenate([np.ravel(leaf) for leaf in leaves])
        # The arguments come last.
        sizes = [np.size(x) for x in arguments]
        parts = np.split(memory, len(memory) - sum(sizes) + np.cumsum([0, *sizes]))
        shapes = [np.shape(x) for x in arguments]
        places = [x.reshape(shape) for x, shape in zip(parts[1:], shapes, strict=False)]
        evaluate = BoundEvaluate(library, memory, result)

        def Run(*arguments: Any) -> Array:
            for place, argument in zip(places, arguments, strict=True):
                place[...] = argument
            evaluate()
            return result.copy()

        return Run


class _Local(threading.local):
    """The state of a law in a thread: its calls so far, and what is called from now."""

    num_calls = 0
    run: Law | None = None


def _LeavesOf(value: Any) -> list[Any]:
    """Returns the numbers and arrays in (named) tuples and lists of them."""
    if isinstance(value, (tuple, list)):
        return [leaf for item in value for leaf in _LeavesOf(item)]
    return [value]


def _LibraryOf(law: FunctionType, samples: Sequence[Any]) -> Library:
    """Returns a law as machine code for arguments with the shapes of the samples."""
    program = TraceLaw(law, samples)
    data, _ = Kept(law.__name__.strip("<>"), MakeCode(program))
    return Library(data, "evaluate")
