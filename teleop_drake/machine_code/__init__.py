"""Functions of numbers and arrays as machine code, by LLVM.

**Laws and diagrams** are plain Python and numpy. `following` calls a function with
arrays of `symbols.Number`s in the place of floats. What it does with them becomes a
graph of operations on single numbers (`tracing`): loops, slices, products of matrices
and helpers are gone from it. Where the function asks whether a comparison holds, it is
called once for each answer, and the graph merges the ways. `traced_numpy` says what the
functions of numpy, math and Python do with Numbers. `scalar_code` writes the graph in
LLVM's language, each operation where it is first needed, a merge as branches.

**The integrator and other loops** over arrays, whose rounds depend on the numbers, are
translated statement by statement (`typed_code`, `typed_expressions`), with types that
follow from the arguments.

* *Compiled and kept.* `native` makes an object file of LLVM's code and links it into
  the process. `cache` keeps it on disk by the hash of the code, of llvmlite's version
  and of the processor. It cannot be out of date: each process traces anew.
* *Read when traced.* Machine code holds what functions read from outside of their
  arguments as it was when they were traced, as in numba and JAX. No trace is kept: each
  diagram that is compiled, and each CompiledLaw, traces anew.
* *Refused*, by function and line: what is in no graph, such as loops until numbers have
  converged, caught errors, random numbers, state that changes from call to call
  (`contents` sees that), indices in writing that depend on numbers, and functions of
  numpy that are not in the table of docs/blocks.md. So is what would round in
  another way: float32, whole numbers beyond 2^53, LAPACK's eigenvectors with their
  signs. Such a law runs as it is, and its diagram in Drake's Simulator; the log says
  so.
* *Bounds.* A law's index that depends on numbers is compared with each index there is;
  out of bounds its result is nan, as is what Python would raise an error for. A loop's
  index is checked, before the loop where that can be; out of bounds, also below 0, it
  raises an IndexError with function and line.
"""
