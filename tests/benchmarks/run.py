"""Runs the benchmarks: `python tests/benchmarks/run.py --help`, see suite.py."""

import os
import sys
from pathlib import Path

if __name__ == "__main__":
    # One thread: with more, BLAS would keep both cores busy with 2 x 2 matrices.
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    sys.path.insert(0, str(Path(__file__).parents[1]))

    from benchmarks.suite import main

    main()
