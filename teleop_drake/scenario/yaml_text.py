"""Text in YAML, and the trees that it describes.

A "tree" is what YAML knows: dict, list, str, float, int, bool and None.
"""

import re
from pathlib import Path
from typing import Any

import yaml

from teleop_drake.files import ReadText
from teleop_drake.validation import ScenarioError, Show

# Numbers that people write and YAML 1.1 takes for text: it asks for a dot, for a sign
# of the exponent, and for a digit between sign and dot. 1e-2, 1.5e3, -.5
_FLOAT = re.compile(
    r"^[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)[eE][-+]?[0-9]+$"
    r"|^[-+]\.[0-9][0-9_]*$"
)


# libyaml's, where PyYAML was built with it, is several times as fast. Where a text is
# nested too deep, it ends the process.
_MAX_DEPTH = 100
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_SafeLoader):
    """YAML's safe loader with the numbers that people write, and strict about keys.

    PyYAML's own lets the last of equal keys win.
    """

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        keys = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in keys:
                problem = f"duplicate key {key.value!r}"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            keys.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


def _ConstructNumber(loader: Any, node: Any) -> Any:
    """Returns a number; text such as 1:30, which YAML 1.1 takes for 90."""
    if ":" in node.value:
        return node.value
    return _SafeLoader.yaml_constructors[node.tag](loader, node)


_Loader.add_constructor("tag:yaml.org,2002:int", _ConstructNumber)
_Loader.add_constructor("tag:yaml.org,2002:float", _ConstructNumber)


class Dumper(yaml.SafeDumper):
    """YAML's safe dumper, which puts text that _Loader takes for a number in quotes."""


for _class in (_Loader, Dumper):
    _class.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, [*"-+.0123456789"])


def DumpYaml(tree: Any, *, is_compact: bool = False) -> str:
    """Returns a YAML text of which ParseYaml() makes the tree, keys in their order.

    Args:
        is_compact: Whether the innermost mappings and lists are on one line each.
    """
    style = None if is_compact else False
    text = yaml.dump(tree, Dumper=Dumper, sort_keys=False, default_flow_style=style)
    return str(text)


def ParseYaml(text: str, origin: str) -> Any:
    """Returns the tree of a YAML text.

    It is YAML 1.1, in which 1_000 and 0x10 are numbers, with two differences: 1e-2,
    +1e3 and -.5 are numbers, and 1:30 is text.

    Raises:
        ScenarioError: if it is not YAML, or a key stands twice.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=_Loader):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > _MAX_DEPTH:
                raise yaml.YAMLError(f"nested more than {_MAX_DEPTH} deep")
        return yaml.load(text, Loader=_Loader)
    except Exception as e:  # noqa: BLE001
        # PyYAML's constructors also let ValueError, KeyError and more escape, for
        # example on `2020-13-01`.
        reason = getattr(e, "problem", None) or e
        mark = getattr(e, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        message = " ".join(f"{origin}{where}: must be valid YAML ({reason})".split())
        raise ScenarioError(message) from None


def ParseFile(path: Path) -> dict[Any, Any]:
    """Returns the tree of a YAML file, which must be a mapping.

    Raises:
        ScenarioError: If it cannot be read, or is none.
    """
    origin = f"scenario file {str(path)!r}"
    tree = ParseYaml(ReadText(path, origin), origin)
    if not isinstance(tree, dict):
        raise ScenarioError(
            f"{origin}: must hold a mapping of scenario fields, not {Show(tree)}"
        )
    return tree
