"""Compiles functions of numbers and arrays to machine code, by LLVM.

**Laws and diagrams** are plain Python and numpy; they are traced. `following` calls a
function with arrays of `symbols.Number`s in the place of floats. The operations on
these Numbers form a graph of operations on single numbers (`tracing`), without loops,
slices, products of matrices and calls of helpers. Where the function branches on a
comparison, it is called once for each result, and the graph merges the results.
`traced_numpy` defines the functions of numpy, math and Python on Numbers. `scalar_code`
writes the graph in LLVM's language.

**The integrator and other loops** over arrays, whose numbers of rounds depend on the
values, are translated statement by statement (`typed_code`), with types that follow
from the arguments. Python executes their expressions with objects in the place of
numbers and arrays; each operation on these objects writes its instruction
(`typed_values`).

* *Compiled and cached.* `native` makes an object file from LLVM's code and links it
  into the process. It stores the file on disk under the hash of the code, of llvmlite's
  version and of the processor. The cache cannot be out of date, because each process
  traces anew.
* *Read when traced.* As in numba and JAX, machine code contains the values that
  functions read from outside of their arguments when they were traced. The functions
  get copies of these values, which refuse changes (`following`). No trace is reused:
  each compiled diagram, and each CompiledLaw, traces anew.
* *Refused.* A law that cannot be a graph is refused, with function and line. Such a law
  has a loop that ends when a number has converged, catches errors, takes random
  numbers, changes values outside of it, writes at indices that depend on numbers, or
  calls a function of numpy that is not in the table of docs/blocks.md. Operations that
  would round differently are refused as well: float32, constants beyond 2^53, powers of
  whole numbers, and the eigenvectors of LAPACK with their signs. A refused law runs in
  Python, and its diagram in Drake's Simulator; the log has a line with the reason.
* *Bounds.* In a law, an index that depends on numbers is compared with each valid
  index. The result is nan if the index is out of bounds, where Python would raise
  another error, and for a sum or product of whole numbers beyond 2^53. In a loop, the
  index is checked, before the loop if possible. If it is out of bounds or below 0, an
  IndexError names the function and the line.
"""
