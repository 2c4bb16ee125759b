"""The command `teleop-drake show`."""

import argparse

from teleop_drake.cli.options import AddScenarioOptions, Load


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    AddScenarioOptions(parser)


def Execute(args: argparse.Namespace) -> int:
    """Prints the scenario with all overrides."""
    from teleop_drake.scenario import ScenarioToYaml

    print(ScenarioToYaml(Load(args)), end="")
    return 0
