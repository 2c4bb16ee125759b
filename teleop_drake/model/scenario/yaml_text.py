"""Conversion between YAML text and trees of plain data.

A tree consists of the types of YAML: dict, list, str, float, int, bool and None.
"""

import math
import re
from pathlib import Path
from typing import Any

import yaml

from teleop_drake.loops.framework.files import ReadText
from teleop_drake.loops.framework.validation import ScenarioError, Show

# Common forms of numbers that YAML 1.1 reads as text, such as 1e-2, 1.5e3 and -.5. It
# requires a dot, a sign of the exponent, and a digit between sign and dot.
_FLOAT = re.compile(
    r"^[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)[eE][-+]?[0-9]+$"
    r"|^[-+]\.[0-9][0-9_]*$"
)


# Text that is nested too deep would crash libyaml, and with it the process.
_MAX_DEPTH = 100
# The loader of libyaml, if PyYAML was built with it, is several times faster.
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_SafeLoader):
    """YAML's safe loader, which also accepts the numbers of _FLOAT.

    It refuses duplicate keys, of which PyYAML's loaders use the last one.
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
    """Returns a number, or text such as 1:30, which YAML 1.1 reads as the number 90."""
    if ":" in node.value:
        return node.value
    return _SafeLoader.yaml_constructors[node.tag](loader, node)


_Loader.add_constructor("tag:yaml.org,2002:int", _ConstructNumber)
_Loader.add_constructor("tag:yaml.org,2002:float", _ConstructNumber)


class Dumper(yaml.SafeDumper):
    """YAML's safe dumper, which quotes text that _Loader would read as a number."""


for _class in (_Loader, Dumper):
    _class.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, [*"-+.0123456789"])


def DumpYaml(tree: Any, *, is_compact: bool = False) -> str:
    """Returns YAML text that ParseYaml() converts back to the tree.

    Keys retain their order.

    Args:
        tree: The tree.
        is_compact: Whether the innermost mappings and lists are on one line each.
    """
    style = None if is_compact else False
    text = yaml.dump(tree, Dumper=Dumper, sort_keys=False, default_flow_style=style)
    return str(text)


def DumpValue(tree: Any) -> str:
    """Returns YAML text on one line that ParseYaml() converts back to the tree."""
    text = yaml.dump(
        tree, Dumper=Dumper, sort_keys=False, default_flow_style=True, width=math.inf
    )
    # A value that is neither a mapping nor a list has a mark of its end.
    return str(text).removesuffix("...\n").strip()


def ParseYaml(text: str, origin: str) -> Any:
    """Returns the tree of a YAML text.

    The text is YAML 1.1, in which 1_000 and 0x10 are numbers, with two differences:
    1e-2, +1e3 and -.5 are numbers, and 1:30 is text.

    Args:
        text: The text.
        origin: The source of the text, for messages.

    Raises:
        ScenarioError: If the text is not YAML, or contains a key twice.
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
        # PyYAML's constructors also raise ValueError, KeyError and others, for example
        # on `2020-13-01`.
        reason = getattr(e, "problem", None) or e
        mark = getattr(e, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        message = " ".join(f"{origin}{where}: must be valid YAML ({reason})".split())
        raise ScenarioError(message) from None


def ParseFile(path: Path) -> dict[Any, Any]:
    """Returns the tree of a YAML file, which must be a mapping.

    Raises:
        ScenarioError: If the file cannot be read or is not a mapping in YAML.
    """
    origin = f"scenario file {str(path)!r}"
    tree = ParseYaml(ReadText(path, origin), origin)
    if not isinstance(tree, dict):
        raise ScenarioError(
            f"{origin}: must hold a mapping of scenario fields, not {Show(tree)}"
        )
    return tree
