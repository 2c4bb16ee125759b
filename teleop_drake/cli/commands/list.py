"""The command `teleop-drake list`."""

import argparse
import re
from pathlib import Path

_PACKAGE = Path(__file__).parents[2]
_OF_THE_THESIS = ("direct_force", "adaptive_backstepping", "network_tracking")


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """The command has no options."""


def KindsOf(seam: str) -> list[str]:
    """Returns the kinds in a folder of blocks/, such as `robots`.

    They are read from the source texts, because to import these takes a second.
    """
    sources = [
        x.read_text("utf-8") for x in sorted((_PACKAGE / "blocks" / seam).glob("*.py"))
    ]
    return re.findall(r'^    kind = "(\w+)"$', "\n".join(sources), re.MULTILINE)


def Execute(args: argparse.Namespace) -> int:
    """Prints the scenarios, the studies and the kinds of blocks."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    files = sorted((_PACKAGE / "scenarios").glob("*.yaml"))
    width = max(len(file.stem) for file in files)
    print("Scenarios")
    for file in files:
        tree = yaml.load(file.read_text("utf-8"), loader)
        print(f"  {file.stem:<{width}} {tree['title']}. {tree['description']}")
    others = [kind for kind in KindsOf("architectures") if kind not in _OF_THE_THESIS]
    for title, names in {
        "Studies": sorted(file.stem for file in (_PACKAGE / "studies").glob("*.yaml")),
        "Controllers": _OF_THE_THESIS,
        "Other architectures": others,
        "Environments": KindsOf("environments"),
        "Operators": KindsOf("operators"),
        "Robots": KindsOf("robots"),
    }.items():
        print(f"{title}\n  {', '.join(names)}")
    return 0
