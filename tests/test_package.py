"""Tests of what `import teleop_drake` offers."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import teleop_drake as dut


def test_import_is_light():
    """The package imports nothing; a name imports what it needs."""
    code = (
        "import sys, teleop_drake; "
        "names = sorted(m for m in sys.modules if m.startswith('teleop_drake')); "
        "print(names, any(m in sys.modules for m in ('pydrake', 'numpy')))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert run.stdout == "['teleop_drake'] False\n"


@pytest.mark.parametrize("name", dut.__all__)
def test_names_are_those_of_their_files(name):
    value = getattr(dut, name)
    assert value.__module__.startswith("teleop_drake.")
    assert value.__name__ == name
    assert name in dir(dut)


def test_every_name_has_one_place():
    places = [name for names in dut._PLACES.values() for name in names]
    assert sorted(places) == sorted(dut.__all__)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match=r"'teleop_drake' .* 'Simulate'"):
        _ = dut.Simulate


def test_citation_and_changelog_are_of_this_version():
    root = Path(__file__).parent.parent
    citation = yaml.safe_load((root / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == dut.__version__
    changelog = (root / "CHANGELOG.md").read_text("utf-8")
    assert f"\n## {dut.__version__}" in changelog
