"""The command `teleop-drake list`."""

import argparse
from pathlib import Path

_PACKAGE = Path(__file__).parents[2]


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """The command has no options."""


def Execute(args: argparse.Namespace) -> int:
    """Prints the scenarios and the kinds of what they are made of."""
    import yaml

    from teleop_drake.environments import ENVIRONMENT_KINDS
    from teleop_drake.operators import OPERATOR_KINDS
    from teleop_drake.robots import ROBOT_KINDS
    from teleop_drake.scenario import (
        ARCHITECTURES,
        CONTROLLERS,
        TRACKING_CONTROLLERS,
    )

    # To load the scenarios and to import the studies takes a second.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    files = sorted((_PACKAGE / "scenarios").glob("*.yaml"))
    width = max(len(file.stem) for file in files)
    print("Scenarios")
    for file in files:
        tree = yaml.load(file.read_text("utf-8"), loader)
        print(f"  {file.stem:<{width}} {' '.join(tree['description'].split())}")
    studies = sorted(file.stem for file in (_PACKAGE / "studies").glob("*.yaml"))
    print("Studies\n  " + ", ".join(studies))
    print("Controllers\n  " + ", ".join(CONTROLLERS + TRACKING_CONTROLLERS))
    others = [kind for kind in ARCHITECTURES if kind not in CONTROLLERS]
    print("Other architectures\n  " + ", ".join(others))
    print("Environments\n  " + ", ".join(ENVIRONMENT_KINDS.names))
    print("Operators\n  " + ", ".join(OPERATOR_KINDS.names))
    print("Robots\n  " + ", ".join(ROBOT_KINDS.names))
    return 0
