"""WebAssembly of a program: the diagram, and the integrator that runs it.

Both are the LLVM code of a native run, emitted for another machine. The object file of
that machine is a module but for its exports, so that no linker is needed.
"""

import functools
import gzip
from types import FunctionType
from typing import Any, cast

from teleop_drake.compiler.source import Program
from teleop_drake.integrator.advance import advance
from teleop_drake.machine_code.scalar_code import MakeCode, TraceProgram
from teleop_drake.machine_code.typed_code import MakeTypedCode
from teleop_drake.machine_code.typed_expressions import EVALUATE, TypeOf

_TRIPLE = "wasm32-unknown-unknown"

# Returns what advance() does, or -1 after an index outside of an array.
_RUN = """
@fault = external global ptr
declare i64 @advance(ptr, ptr, ptr, double, double, double)
declare void @evaluate(double, ptr, ptr, ptr, ptr, ptr, ptr, i32)
define i32 @run(ptr %problem, ptr %memory, double %end, double %accuracy, double %max) {
  %status = call i64 @advance(ptr @evaluate, ptr %problem, ptr %memory, double %end,
                              double %accuracy, double %max)
  %fault = load ptr, ptr @fault
  %is_whole = icmp eq ptr %fault, null
  %short = trunc i64 %status to i32
  %result = select i1 %is_whole, i32 %short, i32 -1
  ret i32 %result
}
"""

# Numbers of sections, and of what the section `linking` says of symbols.
_CUSTOM, _IMPORTS, _MEMORY_EXPORTS, _LAST = 0, 2, 7, 12
_SYMBOL_TABLE, _FUNCTION, _DATA, _SECTION = 8, 0, 1, 3
_IS_UNDEFINED, _HAS_NAME = 0x10, 0x40


def MakeModule(program: Program, *arguments: Any) -> bytes:
    """Returns a module that exports `run(problem, memory, end, accuracy, max_step)`.

    It imports its memory and C's mathematics from `env`. Addresses below its memory's
    minimum are its own.

    Args:
        program: What is simulated.
        *arguments: As advance() takes them after the function that it integrates.

    Raises:
        Untraceable: If a function does what a graph of operations cannot.
    """
    parameters, integers = program.parameters
    traced = TraceProgram(
        program.text, dict(program.names), program.sizes, len(parameters), integers
    )
    types = (EVALUATE, *map(TypeOf, arguments))
    return _Emit(MakeTypedCode(cast(FunctionType, advance), types), MakeCode(traced))


@functools.lru_cache(maxsize=16)
def _Emit(*codes: str) -> bytes:
    """Returns LLVM's code as a module."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(_TRIPLE).create_target_machine(opt=2)
    head = f'target triple = "{_TRIPLE}"\ntarget datalayout = "{machine.target_data}"\n'
    module, *others = [llvm.parse_assembly(head + code) for code in (*codes, _RUN)]
    for other in others:
        module.link_in(other)
    module.verify()
    for function in module.functions:
        if not function.is_declaration and function.name != "run":
            function.linkage = "internal"
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return _WithExport(machine.emit_object(module), "run")


def _WithExport(data: bytes, name: str) -> bytes:
    """Returns an object file as a module that exports one of its functions."""
    sections = list(_Sections(data))
    symbols = next(
        body for kind, body in sections if kind == _CUSTOM and body[1:8] == b"linking"
    )
    text = name.encode()
    export = bytes([1, len(text)]) + text + b"\0" + _Leb(_IndexOf(symbols[8:], name))
    parts = [data[:8]]
    for kind, body in sections:
        if kind != _CUSTOM:
            # Sections stand by their numbers; 12 counts the data and stands before 10.
            if export and (kind > _MEMORY_EXPORTS):
                parts.append(_Section(_MEMORY_EXPORTS, export))
                export = b""
            parts.append(_Section(kind, body))
    return b"".join(parts)


def _Sections(data: bytes) -> Any:
    """Yields the number and the content of each section."""
    place = 8
    while place < len(data):
        kind = data[place]
        size, place = _ReadLeb(data, place + 1)
        yield kind, data[place : place + size]
        place += size


def _Section(kind: int, body: bytes) -> bytes:
    return bytes([kind]) + _Leb(len(body)) + body


def _IndexOf(linking: bytes, name: str) -> int:
    """Returns the index of a function in the content of the section `linking`."""
    _, place = _ReadLeb(linking, 0)  # The version.
    while linking[place] != _SYMBOL_TABLE:
        size, place = _ReadLeb(linking, place + 1)
        place += size
    _, place = _ReadLeb(linking, place + 1)
    count, place = _ReadLeb(linking, place)
    for _ in range(count):
        kind = linking[place]
        flags, place = _ReadLeb(linking, place + 1)
        index, has_name = 0, kind == _DATA or not flags & _IS_UNDEFINED
        if kind != _DATA:
            index, place = _ReadLeb(linking, place)
            has_name = kind != _SECTION and (has_name or bool(flags & _HAS_NAME))
        if has_name:
            size, place = _ReadLeb(linking, place)
            symbol = linking[place : place + size].decode()
            place += size
            if kind == _FUNCTION and symbol == name:
                return index
        if kind == _DATA and not flags & _IS_UNDEFINED:
            for _ in range(3):
                _, place = _ReadLeb(linking, place)
    raise ValueError(f"the object file has no function {name}")


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


def Packed(data: bytes) -> bytes:
    """Returns data in fewer bytes, always the same for the same data."""
    return gzip.compress(data, mtime=0)
