"""WebAssembly of a program: the diagram, and the integrator that runs it.

Both are the LLVM code of a native run, emitted for another machine. The object file of
that machine is a module but for its exports, so that no linker is needed.
"""

import functools
import gzip
from collections.abc import Iterator
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

# Returns what advance() does, or -1 after an index outside of an array.
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
"""

# Numbers of sections.
_CUSTOM, _IMPORTS, _EXPORTS = 0, 2, 7

# Imports that are no functions.
_NO_FUNCTIONS = b"__linear_memory", b"__indirect_function_table"


def MakeModule(program: Program, *arguments: Any) -> bytes:
    """Returns a module that exports `run(problem, memory, end, accuracy, max_step)`.

    It does what advance() does, and imports its memory and C's mathematics
    from `env`. Addresses below its memory's minimum are its own.

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

    return _WithExport(Kept("page", run + model, Emit), b"run")


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


def _WithExport(data: bytes, name: bytes) -> bytes:
    """Returns an object file as a module that exports the first of its functions."""
    sections = [section for section in _Sections(data) if section[0] != _CUSTOM]
    imports = dict(sections)[_IMPORTS]  # They have the first numbers.
    num, _ = _ReadLeb(imports, 0)
    index = _Leb(num - sum(x in imports for x in _NO_FUNCTIONS))
    export = bytes([1, len(name)]) + name + b"\0" + index
    # Sections stand by their numbers; 12 counts the data and stands before 10.
    place = sum(kind < _EXPORTS for kind, _ in sections)
    sections.insert(place, (_EXPORTS, export))
    module = data[:8]
    for kind, body in sections:
        module += bytes([kind]) + _Leb(len(body)) + body
    return module


def _Sections(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yields the number and the content of each section."""
    place = 8
    while place < len(data):
        kind = data[place]
        size, place = _ReadLeb(data, place + 1)
        yield kind, data[place : place + size]
        place += size


def _Leb(number: int) -> bytes:
    """Returns a whole number as WebAssembly writes it."""
    result = []
    while number > 127:
        result.append(number & 127 | 128)
        number >>= 7
    return bytes([*result, number])


def _ReadLeb(data: bytes, place: int) -> tuple[int, int]:
    """Returns a whole number, and where what follows it begins."""
    number = shift = 0
    while data[place] > 127:
        number |= (data[place] & 127) << shift
        shift, place = shift + 7, place + 1
    return number | data[place] << shift, place + 1


def ConstantsOf(module: bytes) -> int:
    """Returns the size in memory of what is a module's own."""
    name = _NO_FUNCTIONS[0]
    # Behind the name stand the kind of the import and that of its limit.
    place = module.index(name) + len(name) + 2
    pages, _ = _ReadLeb(module, place)
    return pages << 16


def Packed(data: bytes) -> bytes:
    """Returns data in fewer bytes, always the same for the same data."""
    return gzip.compress(data, mtime=0)
