"""How long a user waits before anything happens."""

import subprocess
import sys

from benchmarks.options import Options
from benchmarks.tables import Table
from benchmarks.timing import Alternate

COMMANDS = {
    "python, nothing else": ["-c", "pass"],
    "import numpy": ["-c", "import numpy"],
    "import teleop_drake": ["-c", "import teleop_drake"],
    "import teleop_drake.scenario": ["-c", "import teleop_drake.scenario"],
    "import teleop_drake.simulation": ["-c", "import teleop_drake.simulation"],
    "import teleop_drake.cli": ["-c", "import teleop_drake.cli"],
    "import pydrake.all": ["-c", "import pydrake.all"],
    "teleop-drake --help": ["-m", "teleop_drake", "--help"],
    "teleop-drake list": ["-m", "teleop_drake", "list"],
    "teleop-drake show one_dof": ["-m", "teleop_drake", "show", "one_dof"],
}


def Measure(options: Options) -> list[Table]:
    table = Table(
        name="startup",
        title="Import and start-up",
        note="A fresh process; medians of alternating runs, after one that is not "
        "counted.",
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
