"""How long a user waits before anything happens."""

import subprocess
import sys

from benchmarks.options import Options
from benchmarks.tables import Table
from benchmarks.timing import Alternate

COMMANDS = {
    "python, nothing else": ["-c", "pass"],
    "import teleop_drake.simulation": ["-c", "import teleop_drake.simulation"],
    "teleop-drake --help": ["-m", "teleop_drake", "--help"],
    "teleop-drake list": ["-m", "teleop_drake", "list"],
    "teleop-drake run two_dof_combined": [
        *("-m", "teleop_drake", "run", "two_dof_combined", "--quiet")
    ],
}


def Measure(options: Options) -> list[Table]:
    table = Table(
        name="startup",
        title="Import and start-up",
        note="A fresh process; medians of alternating runs, after one that is not "
        "counted and leaves its machine code on disk.",
    )
    contenders = {
        name: lambda command=command: subprocess.run(
            [sys.executable, *command], check=True, stdout=subprocess.DEVNULL
        )
        for name, command in COMMANDS.items()
    }
    if not options.quick:
        Alternate(contenders, 1)
    measured = Alternate(contenders, options.repeats)
    bare = measured["python, nothing else"].wall
    for name, measurement in measured.items():
        table.Add(
            command=name,
            CPU_s=measurement.cpu,
            wall_s=measurement.wall,
            more_wall_s_than_python=measurement.wall - bare,
        )
    return [table]
