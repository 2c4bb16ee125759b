"""Measures the package and what it is compared with.

    python tests/benchmarks/run.py [--quick] [--only NAME,...] [--json FILE]
                                   [--peers]

Prints tables in markdown; --json also writes them as data. --quick measures little, to
see that everything works. --peers adds JiTCDDE: pip install -e '.[benchmarks]'.
Everything else needs only what the tests need.

Times differ between machines, and on a busy one from minute to minute. Ratios of
medians of alternating runs, in one invocation, are what can be compared.
"""

import argparse
import importlib
import json
import os
import platform
import sys
import time
from importlib import metadata
from pathlib import Path

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


def Machine() -> dict:
    """Returns what a reader of the numbers needs to know about where they are from."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "drake": metadata.version("drake"),
        "numpy": metadata.version("numpy"),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--only", metavar="NAME,...", help=", ".join(BENCHMARKS))
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    names = args.only.split(",") if args.only else list(BENCHMARKS)
    for name in names:
        if name not in BENCHMARKS:
            parser.error(f"--only {name}: must be one of {', '.join(BENCHMARKS)}")
    tables = Measure(names, Options(quick=args.quick, peers=args.peers))
    if args.json is not None:
        data = {
            "machine": Machine(),
            "quick": args.quick,
            "tables": [vars(table) for table in tables],
        }
        args.json.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
