"""WebAssembly of a program: the diagram, and the integrator that runs it.

Both are compiled from the LLVM code of a native run, for another target. The object
file for this target is already a WebAssembly module, so that no linker is needed. It
exports nothing. Instead, it stores the function that a page calls in a table, which the
page's script provides.
"""

import functools
from types import FunctionType
from typing import Any, cast

import llvmlite.binding as llvm

from teleop_drake.loops.engine.advance import advance
from teleop_drake.loops.engine.program import Program
from teleop_drake.loops.jit.native import Kept
from teleop_drake.loops.jit.scalar_code import MakeCode
from teleop_drake.loops.jit.typed_code import MakeTypedCode
from teleop_drake.loops.jit.typed_values import EVALUATE, TypeOf

_TRIPLE = "wasm32-unknown-unknown"

# LLVM's level of optimisation.
_LEVEL = 2

# The length of a model's code above which LLVM generates the module at level 0. The
# other levels take minutes for a block of 40 000 instructions, level 0 a second. Its
# module is a third longer.
_LONG = 600_000

# run() returns the status of advance(), or -1 after an index outside of an array. As it
# is the only function whose address is taken, its place in the table of functions is 1.
_RUN = """
declare void @evaluate(double, ptr, ptr, ptr, ptr, ptr, i32)
define i32 @run(ptr %problem, ptr %memory, double %end,
                double %accuracy, double %max) {
  %status = call i64 @advance(
      ptr @evaluate, ptr %problem, ptr %memory, double %end,
      double %accuracy, double %max)
  %fault = load ptr, ptr @fault
  %is_whole = icmp eq ptr %fault, null
  %short = trunc i64 %status to i32
  %result = select i1 %is_whole, i32 %short, i32 -1
  ret i32 %result
}
@address = constant ptr @run
"""

# The bytes of the module that store one function, at place 1 of the table.
_TABLE = b"\x01\x00\x41\x01\x0b\x01"

# The name under which the memory is imported.
_MEMORY = b"__linear_memory"


def MakeModule(program: Program, *arguments: Any) -> bytes:
    """Returns a module with `run(problem, memory, end, accuracy, max_step)`.

    run() is advance() for the program. Its place in the table of functions is 1. The
    module imports the table, the memory and C's mathematical functions from `env`. The
    addresses below the memory's minimum size are reserved for the module's own data.

    Args:
        program: The program of the diagram.
        *arguments: The problem and the memory, whose types run() takes.

    Raises:
        UnsupportedSystem: If a block's function cannot be traced as a graph of
            operations.
    """
    types = (EVALUATE, *map(TypeOf, (*arguments, 0.0, 0.0, 0.0)))
    run, model = _Run(types), _Head() + MakeCode(program.Trace())

    def Emit(_: str) -> bytes:
        # Most of the code is the same for all models, and is optimised once.
        module = llvm.parse_bitcode(Kept("run", run, _Optimised))
        module.link_in(llvm.parse_bitcode(_Optimised(model)))
        machine = _Machine(0 if len(model) > _LONG else _LEVEL)
        data: bytes = machine.emit_object(module)
        return data

    module = Kept("page", run + model, Emit)
    assert _TABLE in module
    return module


@functools.cache
def _Machine(level: int = _LEVEL) -> Any:
    """Returns LLVM's target machine for WebAssembly that generates code at a level."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(_TRIPLE).create_target_machine(opt=level)


def _Head() -> str:
    """Returns the first lines of LLVM code for this target.

    The comment in them separates levels of optimisation in the cache.
    """
    layout = f'target datalayout = "{_Machine().target_data}"\n'
    return f'; level {_LEVEL}\ntarget triple = "{_TRIPLE}"\n{layout}'


@functools.cache
def _Run(types: tuple[Any, ...]) -> str:
    """Returns LLVM code of run() and of all functions that it calls but evaluate()."""
    code = MakeTypedCode(cast(FunctionType, advance), types)
    return _Head() + _RUN + code


def _Optimised(code: str) -> bytes:
    """Returns optimised bitcode of LLVM code; only run() and evaluate() are visible."""
    module = llvm.parse_assembly(code)
    module.verify()
    for function in module.functions:
        if not function.is_declaration and function.name not in ("run", "evaluate"):
            function.linkage = "internal"
    options = llvm.create_pipeline_tuning_options(speed_level=_LEVEL)
    builder = llvm.create_pass_builder(_Machine(), options)
    builder.getModulePassManager().run(module, builder)
    bitcode: bytes = module.as_bitcode()
    return bitcode


def ConstantsOf(module: bytes) -> int:
    """Returns the size in bytes of the memory reserved for a module's own data."""
    # The name is followed by the kind of the import, the kind of its limit, and the
    # number of pages, which is one byte up to 127.
    place = module.index(_MEMORY) + len(_MEMORY) + 2
    num_pages = module[place]
    assert num_pages < 128
    return num_pages << 16
