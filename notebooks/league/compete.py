"""One search of an entry, and the held-out runs of what it finds."""

import json
from collections.abc import Sequence
from pathlib import Path

from league.entries import Entry
from league.felt import FeltRow
from league.runs import Outcome, Runs
from league.search import FindFront, Hypervolume, Members, Search, Terms, Trial
from league.statistics import Row


def Compete(entry: Entry, budget: int, seed: int, file: Path) -> None:
    """Searches for an entry's gains, does its held-out runs, and writes a file."""
    if file.exists():
        return
    trials = Search(entry, budget, seed)
    runs = Runs("league_held_out", entry)
    known: dict[str, dict[str, Outcome]] = {}
    members: dict[str, Row] = {}
    for name, trial in Members(trials).items():
        if seed > 0 and name != "compromise":
            continue
        key = json.dumps(trial.gains)
        if key not in known:
            known[key] = runs.Simulate(trial.gains)
        members[name] = {"gains": trial.gains, "training": trial.terms}
        members[name]["runs"] = known[key]
        if seed == 0:
            members[name]["felt"] = FeltRow(entry, name, trial.gains)
    text = json.dumps({"search": _SearchRow(entry, seed, trials), "members": members})
    temporary = file.with_suffix(".new")
    temporary.write_text(text, encoding="utf-8")
    temporary.rename(file)


def _SearchRow(entry: Entry, seed: int, trials: Sequence[Trial]) -> Row:
    """Returns the row of a search in league_search.csv."""
    front = FindFront(trials)
    best = Members(trials)["compromise"]
    row: Row = {"architecture": entry.name, "seed": seed, "sets": len(trials) - 1}
    row |= {"front": len(front), "hypervolume": Hypervolume(front), "cost": best.cost}
    row |= best.terms._asdict()
    # The least cost if one of the terms counts twice.
    for k, term in enumerate(Terms._fields):
        row[f"cost_2_{term}"] = min(trial.cost + trial.terms[k] for trial in trials)
    rounded = {
        key: float(f"{value:.4g}") if isinstance(value, float) else value
        for key, value in row.items()
    }
    return rounded | {"gains": json.dumps(best.gains)}
