"""Tests of what `import teleop_drake` offers."""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
import yaml
from pydrake.systems.framework import DiagramBuilder

import teleop_drake as dut
from teleop_drake.teleoperator import AddTeleoperator


def test_import_is_light():
    """The package imports no room of its own; a name imports what it needs."""
    code = (
        "import sys, teleop_drake; "
        "names = sorted(m for m in sys.modules if m.startswith('teleop_drake')); "
        "print(names, any(m in sys.modules for m in ('pydrake', 'numpy')))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert (
        run.stdout
        == "['teleop_drake', 'teleop_drake.blocks', 'teleop_drake.upper'] False\n"
    )


@pytest.mark.parametrize("name", dut.__all__)
def test_names_are_those_of_their_files(name):
    value = getattr(dut, name)
    assert value.__module__.startswith("teleop_drake.")
    assert value.__name__ == name
    assert name in dir(dut)


def test_every_name_has_one_place():
    tables = (dut._PLACES, dut.blocks._PLACES)
    places = [name for table in tables for names in table.values() for name in names]
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


def test_the_name_of_a_scenario_stands_for_it():
    scenario = dut.LoadScenario("one_dof")
    builder = DiagramBuilder()
    AddTeleoperator(builder, "one_dof")
    builder.Build()
    for diagram in (dut.MakeDiagram("one_dof"), dut.MakeTeleoperator("one_dof")):
        assert diagram.HasSubsystemNamed("master")
    assert dut.AnalyzeStability("one_dof").scenario == scenario
    with pytest.raises(dut.ScenarioError, match="scenario = '1dof'"):
        dut.simulate("1dof")


INSTALLED = """
list
show one_dof --delay 0.05
run one_dof --duration 0.3 --out run --html run.html
compare one_dof --duration 0.3 --out compare
sweep one_dof --delay 0,0.1 --duration 0.3 --jobs 1 --out sweep
diagram one_dof -o loop.svg
analyze one_dof
replay run/one_dof_adaptive_backstepping.npz --out replay.html
reproduce --help
diagram one_dof -o loop.html
page one_dof -o page.html
drive one_dof -o drive.html
docs
docs --out site --parts live,api
"""


@pytest.mark.slow
def test_an_installed_package_has_all_that_its_commands_need(tmp_path):
    """From a wheel, beside the libraries of the tests, outside the source tree."""
    root, python = Path(__file__).parent.parent, tmp_path / "env/bin/python"
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path],
        cwd=root,
        check=True,
    )
    venv.create(tmp_path / "env")
    (wheel,) = tmp_path.glob("*.whl")
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-index"]
    subprocess.run([*pip, "--no-deps", wheel], check=True)
    (packages,) = tmp_path.glob("env/lib/*/site-packages")
    (packages / "tests.pth").write_text(sysconfig.get_path("purelib"))
    folder = tmp_path / "empty"
    folder.mkdir()
    for command in INSTALLED.strip().splitlines():
        run = subprocess.run(
            [python.with_name("teleop-drake"), *command.split()],
            cwd=folder,
            env={x: y for x, y in os.environ.items() if x != "PYTHONPATH"},
            capture_output=True,
            text=True,
        )
        assert run.returncode == 0, f"{command}: {run.stderr}"
        if command == "docs":
            assert run.stdout.startswith(str(packages))
    assert {path.name for path in folder.iterdir()} == {
        *("run", "run.html", "compare", "sweep", "loop.svg", "replay.html"),
        *("loop.html", "page.html", "drive.html", "site"),
    }
