"""The command `teleop-drake show`."""

import argparse

from teleop_drake.cli.options import AddScenarioOptions, Load, OverridesOf
from teleop_drake.cli.progress import Notice


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    AddScenarioOptions(parser)


def Execute(args: argparse.Namespace) -> int:
    """Prints the scenario with all overrides.

    With user-defined kinds, whose code is not run, it prints the given fields only.
    """
    from teleop_drake.scenario import ScenarioToYaml
    from teleop_drake.scenario.loading import ReadScenario
    from teleop_drake.scenario.yaml_text import DumpYaml

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
