"""The command `teleop-drake show`."""

import argparse
from typing import TYPE_CHECKING

from teleop_drake.cli.options import AddScenarioOptions, Load, OverridesOf
from teleop_drake.cli.progress import Notice

if TYPE_CHECKING:
    from teleop_drake.model.scenario import AnyScenario


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    AddScenarioOptions(parser)
    parser.add_argument(
        "--netem",
        action="store_true",
        help="print instead, for each channel, the command with which a link of Linux "
        "behaves so, and what netem cannot do of it",
    )


def Execute(args: argparse.Namespace) -> int:
    """Prints the scenario with all overrides.

    With user-defined kinds, whose code is not run, it prints the given fields only.
    """
    if args.netem:
        print("\n".join(_NetemLines(Load(args))))
        return 0
    from teleop_drake.model.scenario import ScenarioToYaml
    from teleop_drake.model.scenario.loading import ReadScenario
    from teleop_drake.model.scenario.yaml_text import DumpYaml

    tree, own = ReadScenario(args.scenario, OverridesOf(args, imports=False))
    if not own:
        print(ScenarioToYaml(Load(args)), end="")
        return 0
    print(DumpYaml(tree, is_compact=True), end="")
    programs = ", ".join(f"{field} = {name}" for field, name in own.items())
    Notice(
        f"{programs}: a program of the scenario's own, which `show` does not run. So "
        "nothing is checked, and no default is shown"
    )
    return 0


def _NetemLines(scenario: "AnyScenario") -> list[str]:
    """Returns the command of each channel, and what netem cannot do, as comments."""
    from teleop_drake.model.tasks import TaskOf

    lines = []
    for name, channel in TaskOf(scenario).Channels(scenario).items():
        options, missing = channel.AsNetem(scenario.duration)
        lines.append(f"# {name}; DEV is the network interface of its sender")
        lines.append(f"tc qdisc add dev DEV root netem {options.Line()}".rstrip())
        lines += [f"# not in netem: {what}" for what in missing]
    return lines
