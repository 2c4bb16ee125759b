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
* *Looked up again.* Machine code holds what functions read from outside of their
  arguments. `surroundings` compares all of that before each run, and before each call
  of a compiled law; what has changed is traced anew.
* *Refused*, by function and line: what is in no graph, such as loops until numbers have
  converged, caught errors, random numbers, state that changes from call to call
  (`contents` sees that), indices in writing that depend on numbers, and functions of
  numpy that are not in the list below. Such a law runs as it is, and its diagram in
  Drake's Simulator; the log says so.
* *Bounds.* A law's index that depends on numbers is compared with each index there is;
  out of bounds its result is nan, as is what Python would raise an error for. A loop's
  index is checked, before the loop where that can be; out of bounds, also below 0, it
  raises an IndexError with function and line. Of a singular matrix, svd's U is nan.

Functions that a law may call with what depends on numbers, besides operators and
methods of arrays:

* numpy: absolute, add, all, any, append, arange, arccos, arcsin, arctan, arctan2,
  argmax, argmin, argwhere, array, array_split, asarray, ascontiguousarray, atleast_1d,
  atleast_2d, bitwise_and, bitwise_or, bitwise_xor, block, broadcast_to, ceil, clip,
  column_stack, concatenate, conjugate, copy, copysign, cos, cosh, count_nonzero, cross,
  cumprod, cumsum, deg2rad, degrees, delete, diag, diagonal, diff, divide, dot, einsum,
  empty, empty_like, equal, exp, expand_dims, eye, fabs, flatnonzero, flip, fliplr,
  flipud, floor, floor_divide, fmod, full, full_like, greater, greater_equal, hstack,
  hypot, identity, inner, insert, interp, invert, isfinite, isinf, isnan, kron, less,
  less_equal, linspace, log, logical_and, logical_not, logical_or, matmul, max, maximum,
  mean, min, minimum, moveaxis, multiply, ndim, negative, nonzero, not_equal, ones,
  ones_like, outer, polyval, positive, power, prod, rad2deg, radians, ravel, reciprocal,
  remainder, repeat, reshape, rint, roll, round, searchsorted, shape, sign, sin, sinh,
  size, sort, split, sqrt, square, squeeze, stack, subtract, sum, swapaxes, tan, tanh,
  tensordot, tile, trace, transpose, tril, triu, trunc, vdot, vecdot, vstack, where,
  zeros, zeros_like.
* numpy.linalg: det, eigh, inv, norm, solve, svd.
* math: acos, asin, atan, atan2, ceil, copysign, cos, cosh, degrees, exp, fabs, floor,
  fmod, hypot, isfinite, isinf, isnan, log, pow, radians, sin, sinh, sqrt, tan, tanh,
  trunc.
* Python: bool, float, int, isinstance, max, min.
"""
