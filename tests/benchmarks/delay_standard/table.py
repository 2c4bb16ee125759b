"""The delay standard's table: simulators against tasks, with errors and verdicts.

    python tests/benchmarks/run.py --only delay_standard.table --peers
    python -m benchmarks.delay_standard.table SIMULATOR TASK     (in tests/)

The second one writes the answers of one simulator to one task as a file for
`teleop-drake check`.
"""

import importlib
import sys
from collections.abc import Iterator
from importlib.metadata import distributions, version

import numpy as np
from benchmarks.delay_standard.simulator import ANSWERS, NotOffered, Simulator
from benchmarks.delay_standard.write_references import FOLDER, text
from benchmarks.measuring import Options, Table

from teleop_drake.cli import reference_runs


class Adapter:
    """Where an adapter is.

    Attributes:
        distribution: The package that is simulated with, for its version.
        is_peer: Whether it has to be installed for this.
    """

    def __init__(self, module: str, name: str, distribution: str, *arguments: str):
        self.distribution = distribution
        self.is_peer = distribution not in ("teleop-drake", "drake", "scipy")
        self._module = module
        self._name = name
        self._arguments = arguments

    @property
    def is_installed(self) -> bool:
        names = {item.metadata["Name"] for item in distributions()}
        return self.distribution in names

    def make(self) -> Simulator:
        module = importlib.import_module(f"benchmarks.delay_standard.{self._module}")
        return getattr(module, self._name)(*self._arguments)


ADAPTERS = {
    "compiled": Adapter("package", "Package", "teleop-drake", "compiled"),
    "drake": Adapter("package", "Package", "teleop-drake", "drake"),
    "discrete": Adapter("drake_delay", "DiscreteDelay", "drake"),
    "pathsim": Adapter("pathsim_blocks", "PathSim", "pathsim"),
    "jitcdde": Adapter("jitcdde_loops", "Jitcdde", "jitcdde"),
    "jaxonomy": Adapter("jaxonomy_blocks", "Jaxonomy", "jaxonomy"),
    "ddeint": Adapter("ddeint_loops", "Ddeint", "ddeint"),
    "ring_buffer": Adapter("ring_buffer", "RingBuffer", "scipy"),
    "pade": Adapter("pade", "Pade", "control"),
    "mujoco": Adapter("mujoco_delays", "MuJoCo", "mujoco"),
}


def answers(simulator: Simulator, task: str) -> reference_runs.Table:
    """Returns the columns of a task as a simulator has them.

    Raises:
        NotOffered: If it is not made for the task.
    """
    reference = reference_runs.ReadTable(FOLDER / f"{task}.csv").columns
    times = reference["time"]
    values = ANSWERS[task](simulator, times).reshape(len(times), -1)
    columns = dict(zip(reference, [times, *values.T], strict=True))
    return reference_runs.Table(notes={"reference": task}, columns=columns)


def verdict(simulator: Simulator, task: str) -> str:
    """Returns the largest error of a signal, and the faults if one is outside."""
    try:
        run = answers(simulator, task)
    except NotOffered as reason:
        return f"- ({reason})"
    found = reference_runs.Compare(task, run, task).values()
    largest = max(difference.largest for difference in found)
    if all(difference.is_inside for difference in found):
        return f"inside, {largest:.0e}"
    faults = sorted({difference.fault.split(":")[0] for difference in found} - {""})
    return f"outside, {largest:.0e}" + "".join(f"; {fault}" for fault in faults)


def Measure(options: Options) -> Iterator[Table]:
    """Yields the table of what is installed; without --peers, no others are asked."""
    tasks = list(ANSWERS)[:3] if options.quick else list(ANSWERS)
    rows = []
    for key, adapter in ADAPTERS.items():
        if adapter.is_peer and not (options.peers and adapter.is_installed):
            continue
        simulator = adapter.make()
        title = f"{simulator.name} {version(adapter.distribution)} (`{key}`)"
        row = {"simulator": title}
        row |= {task: verdict(simulator, task) for task in tasks}
        rows.append(row)
    yield Table(
        title="The delay standard",
        note="Inside or outside of the tubes, with the largest error. A row that fails "
        "is repeated by `python -m benchmarks.delay_standard.table NAME TASK`, in "
        "tests/, whose output `teleop-drake check` reads.",
        rows=rows,
    )


def main(key: str, task: str) -> None:
    """Prints the answers of a simulator to a task."""
    run = answers(ADAPTERS[key].make(), task)
    columns = {name: np.asarray(x).tolist() for name, x in run.columns.items()}
    print(text(run.notes, columns), end="")


if __name__ == "__main__":
    main(*sys.argv[1:])
