"""The result of a search for gains, as a table and as files."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from teleop_drake.loops.framework.arrays import Array, Record
from teleop_drake.loops.framework.files import WriteText
from teleop_drake.model.scenario.yaml_text import DumpYaml
from teleop_drake.study.sweep.folder import WriteCsv
from teleop_drake.study.sweep.tuning.plan import TuningPlan
from teleop_drake.study.sweep.tuning.trials import Trial


@dataclass(kw_only=True)
class TuningResult:
    """The result of a search.

    Attributes:
        plan: The search.
        own: The scenario's own gains.
        reference: The reference gains.
        best: The member of the front with the smallest goal, which is the weighted sum
            of the scores or, without weights, the largest score.
        front: The accepted gains that no other gains dominate, ascending in the first
            metric; with weights only the best.
        held_out: The held-out runs of the scenario's own gains and of the front.
        tried: All sets of gains that were tried in the training runs.
    """

    plan: TuningPlan
    own: Trial
    reference: Trial
    best: Trial
    front: list[Trial]
    held_out: list[Trial]
    tried: list[Trial] = field(repr=False)

    def Scores(self, trial: Trial) -> Array:
        """Returns the score of each metric (M), in multiples of the reference."""
        return trial.Scores(self.reference)

    def Table(self) -> list[Record]:
        """Returns the rows of tuning.csv: one for each set of gains and scenario.

        `bounded` is the number of runs that reach their end and have every metric. The
        mean and the largest value over these runs follow for each metric.
        """
        trials = {"training": [self.own, *self.front], "held out": self.held_out}
        return [
            row
            for runs, shown in trials.items()
            for i, trial in enumerate(shown)
            for row in self._Rows(trial, i, runs)
        ]

    def Title(self, i: int) -> str:
        """Returns the name of the scenario's own gains (0), or of a member (1, ...)."""
        if i == 0:
            return "own"
        return f"front-{i}" if len(self.front) > 1 else "best"

    def _Rows(self, trial: Trial, i: int, runs: str) -> list[Record]:
        """Returns the rows of a set of gains, one for each scenario."""
        rows = []
        for scenario, values in trial.values.items():
            good = values[np.isfinite(values).all(axis=1)]
            row: Record = {"gains": self.Title(i), "runs": runs}
            row |= dict.fromkeys(self.plan.ranges) | trial.gains
            row |= {"scenario": scenario, "count": len(values), "bounded": len(good)}
            for metric, x in zip(self.plan.weights, good.T, strict=True):
                row[f"{metric} mean"] = float(x.mean()) if len(x) else None
                row[f"{metric} worst"] = float(x.max()) if len(x) else None
            rows.append(row)
        return rows

    def Write(self, folder: Path) -> list[Path]:
        """Writes the gains and the table; returns the paths of the files.

        `gains.yaml` contains the best gains and `front-N.yaml` the members of a front.
        Each is a mapping of paths to values, for --set and the `overrides` of a study.
        """
        trials = {"gains": self.best}
        if len(self.front) > 1:
            trials |= {f"front-{i}": x for i, x in enumerate(self.front, start=1)}
        sweep = next(iter(self.plan.training.values()))
        kind = {"controller.kind": sweep.scenario.controller.kind}
        files = [folder / f"{name}.yaml" for name in trials]
        for file, trial in zip(files, trials.values(), strict=True):
            WriteText(file, DumpYaml(kind | trial.gains))
        return [*files, WriteCsv(folder / "tuning.csv", self.Table())]
