"""The command `teleop-drake list`."""

import argparse
from pathlib import Path

# Those of sweep.study, whose import takes half a second.
_STUDIES = Path(__file__).parents[2] / "studies"


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """The command has no options."""


def Execute(args: argparse.Namespace) -> int:
    """Prints the scenarios and the kinds of what they are made of."""
    from teleop_drake.environments import ENVIRONMENT_KINDS
    from teleop_drake.operators import OPERATOR_KINDS
    from teleop_drake.robots import ROBOT_KINDS
    from teleop_drake.scenario import (
        ARCHITECTURES,
        CONTROLLERS,
        TRACKING_CONTROLLERS,
        ScenarioNames,
    )
    from teleop_drake.scenario.scenario import ReadScenario

    print("Scenarios")
    width = max(map(len, ScenarioNames()))
    for name in ScenarioNames():
        tree, _ = ReadScenario(name)  # To load and check them all takes a second.
        print(f"  {name:<{width}} {' '.join(tree['description'].split())}")
    studies = sorted(path.stem for path in _STUDIES.glob("*.yaml"))
    print("Studies\n  " + ", ".join(studies))
    print("Controllers\n  " + ", ".join(CONTROLLERS + TRACKING_CONTROLLERS))
    others = [kind for kind in ARCHITECTURES if kind not in CONTROLLERS]
    print("Other architectures\n  " + ", ".join(others))
    print("Environments\n  " + ", ".join(ENVIRONMENT_KINDS.names))
    print("Operators\n  " + ", ".join(OPERATOR_KINDS.names))
    print("Robots\n  " + ", ".join(ROBOT_KINDS.names))
    return 0
