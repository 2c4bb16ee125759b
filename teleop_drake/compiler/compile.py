"""Machine code of a generated program and of the integrator, kept on disk."""

import functools
from collections.abc import Callable
from types import FunctionType
from typing import Any, cast

import numpy as np

from teleop_drake.compiler.source import Program
from teleop_drake.integrator.advance import advance
from teleop_drake.machine_code.cache import Kept
from teleop_drake.machine_code.native import Evaluate, Integrator, Library
from teleop_drake.machine_code.scalar_code import MakeCode, TraceProgram
from teleop_drake.machine_code.surroundings import UpToDate
from teleop_drake.machine_code.typed_code import MakeTypedCode
from teleop_drake.machine_code.typed_expressions import EVALUATE, TypeOf


def CompileIntegrator(*arguments: Any) -> Integrator:
    """Returns integrator.advance.advance() as machine code.

    It is compiled once a process for all diagrams, as nothing in it is a user's, and
    kept in the user's cache.
    """
    return _Integrator((EVALUATE, *map(TypeOf, arguments)))


@functools.cache
def _Integrator(types: tuple[Any, ...]) -> Integrator:
    data, _ = Kept("advance", MakeTypedCode(cast(FunctionType, advance), types))
    return Integrator(Library(data, "advance", "fault"))


def CompileEvaluate(program: Program) -> Evaluate:
    """Returns the function `evaluate` of a program as machine code.

    The code is kept in the user's cache.

    Raises:
        Untraceable: If a function does what a graph of operations cannot, such as a
            loop until something has converged.
    """
    parameters, integers = program.parameters
    evaluate, _ = _Compiled(
        program.text,
        tuple(program.names.items()),
        program.sizes,
        len(parameters),
        tuple(integers.tolist()),
    ).Get()
    return evaluate


@functools.cache
def _Compiled(
    text: str,
    names: tuple[tuple[str, Callable[..., Any]], ...],
    sizes: tuple[int, int, int],
    num_parameters: int,
    integers: tuple[int, ...],
) -> UpToDate[Evaluate]:
    def Make() -> Evaluate:
        q = np.array(integers, np.int64)
        traced = TraceProgram(text, dict(names), sizes, num_parameters, q)
        data, is_from_cache = Kept("evaluate", MakeCode(traced))
        library = Library(data, "evaluate")
        return Evaluate(library.Address("evaluate"), library, is_from_cache)

    return UpToDate([function for _, function in names], Make)
