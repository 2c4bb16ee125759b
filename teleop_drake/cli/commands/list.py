"""The command `teleop-drake list`."""

import argparse
import re
from pathlib import Path

_PACKAGE = Path(__file__).parents[2]
_OF_THE_THESIS = ("direct_force", "adaptive_backstepping", "network_tracking")


def AddOptions(parser: argparse.ArgumentParser) -> None:
    """The command has no options."""


def FilesIn(folder: str) -> dict[str, Path]:
    """Returns the YAML files in a folder of the package, by their names.

    They are listed without importing Drake, which takes a second.
    """
    files = sorted((_PACKAGE / folder).glob("*.yaml"))
    return {file.stem: file for file in files}


def KindsOf(seam: str) -> list[str]:
    """Returns the kinds in a folder of blocks/, such as `robots`.

    They are read from the source texts, because to import these takes a second.
    """
    sources = [
        x.read_text("utf-8")
        for x in sorted((_PACKAGE / "model" / "blocks" / seam).glob("*.py"))
    ]
    return re.findall(r'^    kind = "(\w+)"$', "\n".join(sources), re.MULTILINE)


def Execute(args: argparse.Namespace) -> int:
    """Prints the scenarios, the studies and the kinds of blocks."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    scenarios = FilesIn("model/scenarios")
    width = max(map(len, scenarios))
    print("Scenarios")
    for name, file in scenarios.items():
        tree = yaml.load(file.read_text("utf-8"), loader)
        print(f"  {name:<{width}} {tree['title']}. {tree['description']}")
    others = [kind for kind in KindsOf("architectures") if kind not in _OF_THE_THESIS]
    for title, names in {
        "Studies": FilesIn("study/studies"),
        "Controllers": _OF_THE_THESIS,
        "Other architectures": others,
        "Environments": KindsOf("environments"),
        "Operators": KindsOf("operators"),
        "Robots": KindsOf("robots"),
    }.items():
        print(f"{title}\n  {', '.join(names)}")
    return 0
