"""The league of architectures, edition 3: `python -m league DIR` in notebooks/.

Each entry of entries.yaml gets its gains by a search with a cost common to all (see
search.py), five times with other seeds, in the runs of the study `league`. Then the
study `league_held_out`, with two traces of delays, is run with the members of the
fronts that are named: the compromise of each search, the gains by rule, and the
compromise of a further search in ranges that are twice as wide at both ends. DIR gets
a file for each search as it ends, and only what is missing there is computed. It also
gets the tables

    league.csv         a row for each member and group of held-out runs (statistics)
    league_runs.csv    a row for each compromise and held-out run (outcome by seed)
    league_search.csv  a row for each search (cost, hypervolume, gains)
    league_felt.csv    a row for each member (what the hand feels, passivity)

and the figure league.png. `--enter FILE` adds the entries of another file of this form;
with `--only NAME` nothing else is computed. `--publish` writes the tables beside this
file, and the figures, the table and the sentences into the documentation.
"""

import argparse
import json
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from league.compete import Compete
from league.entries import ENTRIES, ReadEntries
from league.figures import Draw, DrawFelt
from league.page import WritePage
from league.statistics import FOLDER, ReadTable, Row, RunRows, StatisticsRows
from teleop_drake.cli.dask import DaskExecutor
from teleop_drake.study.figures.runs import SaveFigure
from teleop_drake.study.sweep.folder import WriteCsv

BUDGET = 20
SEEDS = 5
DOCS = FOLDER.parents[1] / "teleop_drake/docs"


def WriteTables(folder: Path, results: dict[str, list[Row]]) -> None:
    """Writes the four tables of a league into a folder, from the results by seed."""
    runs = [row for name, items in results.items() for row in RunRows(name, items)]
    searches = [
        item["search"] | {"cost_twice": _CostTwice(item)}
        for items in results.values()
        for item in items
    ]
    felt = [
        member["felt"]
        for items in results.values()
        for member in items[0]["members"].values()
    ]
    of_compromise = [row for row in runs if row["member"] == "compromise"]
    tables = {"league_runs": of_compromise, "league": StatisticsRows(runs)}
    tables |= {"league_search": searches, "league_felt": felt}
    for name, rows in tables.items():
        WriteCsv(folder / f"{name}.csv", rows)


def _CostTwice(item: Row) -> float | str:
    """Returns the cost of the search in wider ranges, if a seed has it."""
    member = item["members"].get("twice the range")
    return float(f"{member['cost']:.4g}") if member else ""


def _Arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the results are kept")
    parser.add_argument("--budget", type=int, default=BUDGET, help="sets for each gain")
    parser.add_argument(
        "--seeds", type=int, default=SEEDS, help="searches of each entry"
    )
    parser.add_argument("--enter", type=Path, help="a file with entries of your own")
    parser.add_argument(
        "--only", action="append", help="an entry; all others are left out"
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=2,
        help="number of processes; 0: tabulate what is there",
    )
    parser.add_argument("--dask", help="address of a Dask scheduler")
    parser.add_argument("--publish", action="store_true", help="write the repository's")
    return parser.parse_args()


def main() -> None:
    """Computes what is missing, and writes the tables, the figure and the page."""
    options = _Arguments()
    entries = ReadEntries(ENTRIES)
    if options.enter:
        entries |= ReadEntries(options.enter)
    chosen = options.only or list(entries)
    options.folder.mkdir(parents=True, exist_ok=True)

    def FileOf(name: str, seed: int) -> Path:
        return options.folder / f"{name.replace(' ', '_')}-{seed}.json"

    # Entries with many gains take longest, so that they come first. All entries have a
    # first search before one has a second. The searches of a task share compiled runs.
    order = sorted(chosen, key=lambda name: -len(entries[name].gains))
    tasks = [(name, {0: FileOf(name, 0)}) for name in order]
    for name in order:
        if entries[name].gains:
            tasks.append((name, {k: FileOf(name, k) for k in range(1, options.seeds)}))
    missing = [task for task in tasks if not all(x.exists() for x in task[1].values())]
    # A process each: Drake before 1.56 frees no diagram with a block in Python.
    local = ProcessPoolExecutor(
        max(options.jobs, 1), get_context("spawn"), max_tasks_per_child=1
    )
    with DaskExecutor(options.dask) as dask, local:
        executor: Executor = dask or local
        futures = {
            f"{name}, searches {[*files]}": executor.submit(
                Compete, entries[name], options.budget, files
            )
            for name, files in missing[: None if options.jobs else 0]
        }
        for label, future in futures.items():
            future.result()
            print(f"{label}: done", flush=True)
    results: dict[str, list[Row]] = {name: [] for name in chosen}
    for name, files in tasks:
        for file in files.values():
            if file.exists():
                results[name].append(json.loads(file.read_text(encoding="utf-8")))
    folder = FOLDER if options.publish else options.folder
    WriteTables(folder, results)
    tables = [
        ReadTable(name, folder) for name in ("league", "league_runs", "league_felt")
    ]
    SaveFigure(Draw(*tables), (DOCS if options.publish else folder) / "league.png")
    if options.publish:
        SaveFigure(DrawFelt(), DOCS / "felt_stiffness.png")
        WritePage()


if __name__ == "__main__":
    main()
