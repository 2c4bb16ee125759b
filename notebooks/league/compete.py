"""The searches of an entry, and the held-out runs of what they find."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from league.entries import Entry
from league.felt import FeltRow
from league.runs import Outcome, Runs
from league.search import FindFront, Hypervolume, Members, Search, Terms, Trial
from league.statistics import Row

WIDER = 2.0
"""Factor by which ranges are wider in a search that tries to refute what is found."""


def Compete(entry: Entry, budget: int, files: Mapping[int, Path]) -> None:
    """Does the searches of an entry by their seeds, and writes a file for each.

    A file that exists is kept. All searches share the compiled runs.
    """
    training, held_out = Runs("league", entry), Runs("league_held_out", entry)
    known: dict[str, dict[str, Outcome]] = {}
    for seed, file in files.items():
        if file.exists():
            continue
        trials = Search(entry, training, budget, seed)
        found = Members(trials)
        if seed > 0:
            found = {"compromise": found["compromise"]}
        elif entry.gains:
            wider = Search(entry.Widened(WIDER), training, budget, seed)
            found["twice the range"] = Members(wider)["compromise"]
        members: dict[str, Row] = {}
        for name, trial in found.items():
            key = json.dumps(trial.gains)
            if key not in known:
                known[key] = held_out.Simulate(trial.gains)
            members[name] = {"gains": trial.gains, "training": trial.terms}
            members[name] |= {"runs": known[key], "cost": trial.cost}
            if seed == 0:
                members[name]["felt"] = FeltRow(entry, name, trial.gains)
        result = {"search": _SearchRow(entry, seed, trials), "members": members}
        temporary = file.with_suffix(".new")
        temporary.write_text(json.dumps(result), encoding="utf-8")
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
    at_edge = entry.Edges(best.gains)
    return rounded | {"at_edge": at_edge, "gains": json.dumps(best.gains)}
