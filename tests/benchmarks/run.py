"""Measures the package and what it is compared with.

    python tests/benchmarks/run.py [--quick] [--only NAME,...] [--peers]

Prints tables in markdown. --quick measures little, to see that everything works.
--peers adds JiTCDDE: pip install -e '.[benchmarks]'.

Times differ between machines, and on a busy one from minute to minute. Ratios of
medians of alternating runs, in one invocation, are what can be compared.
"""

import argparse
import importlib
import os
import sys
import time
from pathlib import Path

BENCHMARKS = (
    "comparison",
    "evaluation",
    "bars",
    "in_drake",
    "delays",
    "delay_problems",
    "state_delays",
    "delay_standard.table",
)


def main() -> None:
    """Prints each table as soon as it is there."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--only", metavar="NAME,...", help=", ".join(BENCHMARKS))
    args = parser.parse_args()
    names = args.only.split(",") if args.only else BENCHMARKS
    for name in names:
        if name not in BENCHMARKS:
            parser.error(f"--only {name}: must be one of {', '.join(BENCHMARKS)}")
    from benchmarks.measuring import Options

    for name in names:
        start = time.perf_counter()
        module = importlib.import_module(f"benchmarks.{name}")
        for table in module.Measure(Options(quick=args.quick, peers=args.peers)):
            print(table.Markdown(), flush=True)
        seconds = time.perf_counter() - start
        print(f"{name}: {seconds:.0f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    # One thread: with more, BLAS would keep both cores busy with 2 x 2 matrices.
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    sys.path.insert(0, str(Path(__file__).parents[1]))
    main()
