"""Laws that become machine code after some calls."""

import functools
import logging
import threading
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any, cast

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.jit.native import BoundEvaluate, Kept, Library
from teleop_drake.loops.jit.packing import Parameters
from teleop_drake.loops.jit.scalar_code import MakeCode, TraceLaw
from teleop_drake.loops.jit.symbols import Untraceable

Law = Callable[..., Array]

# The number of the call at which a law is compiled. The construction of a diagram or of
# a linear model takes fewer calls and less time than the compilation.
_COMPILED_CALL = 200


@functools.cache
def _TellOnce(law: Law, reason: str) -> None:
    """Logs the reason why a law is not compiled, once for each law."""
    logging.getLogger("teleop_drake").warning("not compiled: %s", reason)


class CompiledLaw:
    """A law that becomes machine code after some calls as a Python function.

    Both compute the same function to within rounding. Values outside of the law's
    arguments are read only when it is traced; a new CompiledLaw traces anew. A law that
    cannot be a graph of operations, see `tracing`, remains a Python function, and the
    reason is logged.

    Args:
        law: A function of numbers and arrays that returns an array. The shapes are the
            same in each call.
        constants: The law's first arguments, which are the same in each call and may be
            named tuples. All whole numbers and arrays of them have to be among these,
            because they determine the structure of the graph.
    """

    def __init__(self, law: Law, *constants: Any):
        self.law = functools.partial(law, *constants)
        self._num_calls = 0
        self._run: Law | None = None

    def __call__(self, *arguments: Any) -> Array:
        """Calls the law."""
        if self._run is None:
            self._num_calls += 1
            if self._num_calls < _COMPILED_CALL:
                with np.errstate(all="ignore"):  # Machine code does not warn either.
                    return self.law(*arguments)
            self._run = self._Compiled(arguments)
        return self._run(*arguments)

    def _Compiled(self, arguments: Sequence[Any]) -> Law:
        """Returns the law as machine code or, if that fails, the law itself."""
        # A first call in Python gives the shape of the result.
        law = cast(FunctionType, self.law.func)
        result = np.array(self.law(*arguments), dtype=float)
        samples = [*self.law.args, *(np.asarray(x, dtype=float) for x in arguments)]
        parameters = Parameters()
        layouts = [parameters.Add(sample) for sample in samples]
        memory = np.array(parameters.numbers)
        try:
            program = TraceLaw(law, layouts, len(memory))
        except Untraceable as error:
            error.place = error.place or f"{law.__name__}()"
            _TellOnce(law, str(error))
            return self.law
        data = Kept(law.__name__.strip("<>"), MakeCode(program))
        # The arguments follow the constants in the memory.
        place = memory[len(memory) - sum(map(np.size, arguments)) :]
        evaluate = BoundEvaluate(Library(data, "evaluate"), memory, result)
        lock = threading.Lock()

        def Run(*arguments: Any) -> Array:
            with lock:  # Threads share the memory.
                if arguments:
                    np.concatenate(arguments, axis=None, out=place)
                evaluate()
                return result.copy()

        return Run
