"""WebAssembly of a program: the diagram, and the integrator that runs it.

Both are the LLVM code of a native run, emitted for another machine. The object file of
that machine is a module that exports nothing, so that no linker is needed: it puts the
function that a page calls into a table, which the page's script gives to it.
"""

import functools
from types import FunctionType
from typing import Any, cast

import llvmlite.binding as llvm

from teleop_drake.engine.advance import advance
from teleop_drake.engine.program import Program
from teleop_drake.jit.native import Kept
from teleop_drake.jit.scalar_code import MakeCode
from teleop_drake.jit.typed_code import MakeTypedCode
from teleop_drake.jit.typed_values import EVALUATE, TypeOf

_TRIPLE = "wasm32-unknown-unknown"

# Optimisation.
_LEVEL = 2

# Returns what advance() does, or -1 after an index outside of an array. As the one
# function whose address is taken, run() has place 1 in the table of functions.
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

# What puts one function, and no other, into the table at place 1.
_TABLE = b"\x01\x00\x41\x01\x0b\x01"

# The import that is the memory.
_MEMORY = b"__linear_memory"


def MakeModule(program: Program, *arguments: Any) -> bytes:
    """Returns a module of `run(problem, memory, end, accuracy, max_step)`.

    It does what advance() does, and stands at place 1 of a table of functions. The
    module imports that table, its memory and C's mathematics from `env`. Addresses
    below its memory's minimum are its own.

    Args:
        program: What is simulated.
        *arguments: The named tuples of arrays that it takes.

    Raises:
        UnsupportedSystem: If a function does what a graph of operations cannot.
    """
    types = (EVALUATE, *map(TypeOf, (*arguments, 0.0, 0.0, 0.0)))
    run, model = _Run(types), _Head() + MakeCode(program.Trace())

    def Emit(_: str) -> bytes:
        # What is the same for all models is most of it, and optimised once.
        module = llvm.parse_bitcode(Kept("run", run, _Optimised))
        module.link_in(llvm.parse_bitcode(_Optimised(model)))
        data: bytes = _Machine().emit_object(module)
        return data

    module = Kept("page", run + model, Emit)
    assert _TABLE in module
    return module


@functools.cache
def _Machine() -> Any:
    """Returns what LLVM knows about WebAssembly."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(_TRIPLE).create_target_machine(opt=_LEVEL)


def _Head() -> str:
    """Returns the lines for this machine; the comment is for the cache."""
    layout = f'target datalayout = "{_Machine().target_data}"\n'
    return f'; level {_LEVEL}\ntarget triple = "{_TRIPLE}"\n{layout}'


@functools.cache
def _Run(types: tuple[Any, ...]) -> str:
    """Returns LLVM's code of run() and of all that it calls but evaluate()."""
    code = MakeTypedCode(cast(FunctionType, advance), types)
    return _Head() + _RUN + code


def _Optimised(code: str) -> bytes:
    """Returns LLVM's code as bitcode, of which others see run() and evaluate()."""
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
    """Returns the size in memory of what is a module's own."""
    # Behind the name stand the kind of the import, that of its limit, and the number
    # of pages, which is one byte up to 127.
    place = module.index(_MEMORY) + len(_MEMORY) + 2
    num_pages = module[place]
    assert num_pages < 128
    return num_pages << 16
