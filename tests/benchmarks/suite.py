"""Measures the package and what it is compared with.

    python tests/benchmarks/run.py [--quick] [--only NAME,...] [--peers]

Prints tables in markdown. --quick measures little, to see that everything works.
--peers adds JiTCDDE: pip install -e '.[benchmarks]'.

Times differ between machines, and on a busy one from minute to minute. Ratios of
medians of alternating runs, in one invocation, are what can be compared.
"""

import argparse
import importlib
import sys
import time

from benchmarks.tables import Table
from benchmarks.timing import Options

BENCHMARKS = ("comparison", "evaluation", "delays")


def Measure(names: list[str], options: Options) -> list[Table]:
    """Runs benchmarks by name and prints each table as soon as it is there."""
    tables = []
    for name in names:
        start = time.perf_counter()
        module = importlib.import_module(f"benchmarks.{name}")
        for table in module.Measure(options):
            print(table.Markdown(), flush=True)
            tables.append(table)
        seconds = time.perf_counter() - start
        print(f"{name}: {seconds:.0f} s", file=sys.stderr, flush=True)
    return tables


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--only", metavar="NAME,...", help=", ".join(BENCHMARKS))
    args = parser.parse_args()
    names = args.only.split(",") if args.only else list(BENCHMARKS)
    for name in names:
        if name not in BENCHMARKS:
            parser.error(f"--only {name}: must be one of {', '.join(BENCHMARKS)}")
    Measure(names, Options(quick=args.quick, peers=args.peers))
