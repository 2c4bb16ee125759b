"""Tests of what `import teleop_drake` offers."""

import ast
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
from pathlib import Path

import pytest
import yaml
from pydrake.systems.framework import DiagramBuilder

import teleop_drake as dut
from teleop_drake.loops import ReadStub
from teleop_drake.model.teleoperator import AddTeleoperator


@pytest.mark.slow
def test_a_sweep_starts_without_scipy():
    """Which takes longer to import than the runs of a short sweep."""
    code = "import sys, teleop_drake.study.sweep; print('scipy' in sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "False"


@pytest.mark.slow
def test_a_run_imports_few_modules():
    """A Diagram of Drake's blocks needs at most 75 modules of the package."""
    code = (
        "import sys, teleop_drake as t; "
        "from pydrake.systems.primitives import Sine; "
        "t.simulate(Sine(1.0, 1.0, 0.0, 1), duration=0.1); "
        "print(sum(m.startswith('teleop_drake') for m in sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert int(run.stdout) <= 75


@pytest.mark.slow
def test_the_tests_limit_blas_before_numpy_is_imported():
    """NumPy reads the number of threads of BLAS when it is imported, not later."""
    code = "import sys, conftest; print('numpy' in sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.strip() == "False"


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
    rooms = ["blocks", "loops", "moved"]
    assert (
        run.stdout
        == f"{['teleop_drake', *(f'teleop_drake.{x}' for x in rooms)]} False\n"
    )


OF_SCENARIOS = ("architectures", "operators", "robots", "scenario", "stations", "tasks")


@pytest.mark.slow
def test_the_page_of_a_system_imports_nothing_of_scenarios():
    """tests/test_architecture.py reads the imports outside of functions only."""
    code = """
import sys
from pydrake.systems.primitives import SymbolicVectorSystem
from pydrake.symbolic import Variable
from teleop_drake.study.page.page import MakePage
x = Variable("x")
system = SymbolicVectorSystem(state=[x], dynamics=[-x], output=[x])
assert MakePage(system).data["controllers"]
print(*{part for name in sys.modules for part in name.split(".") if "teleop" in name})
"""
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert "parameters" in run.stdout.split()
    assert not set(OF_SCENARIOS) & set(run.stdout.split())


@pytest.mark.parametrize("name", dut.__all__)
def test_names_are_those_of_their_files(name):
    value = getattr(dut, name)
    assert value.__module__.startswith("teleop_drake.")
    assert value.__name__ == name
    assert name in dir(dut)


@pytest.mark.parametrize("package", [dut, dut.blocks, dut.loops])
def test_every_import_of_a_stub_is_read(package):
    """`ReadStub` is a regular expression; Python's parser finds the same names."""
    stub = Path(package.__file__).with_suffix(".pyi").read_text("utf-8")
    imports = [x for x in ast.parse(stub).body if isinstance(x, ast.ImportFrom)]
    places = {alias.name: x.module for x in imports for alias in x.names}
    assert ReadStub(package.__file__) == places
    assert len(imports) == len(places)


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


def test_every_dependency_has_a_lower_bound():
    """`.ci/run` runs the tests with these versions."""
    root = Path(__file__).parent.parent
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))
    for requirement in project["project"]["dependencies"]:
        assert re.fullmatch(r"[\w-]+>=\d+(\.\d+)*", requirement), requirement
    extras = project["project"]["optional-dependencies"]
    for group, (extra,) in project["dependency-groups"].items():
        assert extra == f"teleop-drake[{group}]" and group in extras


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
reproduce --check --only 3-effects-of-delay
docs
docs --out site --parts live,api
"""


# What the tests of the source archive are tried on, to be short.
SOME_TESTS = ("tests/loops/numerics/test_pieces.py", "tests/cli/test_tables.py")


def _Build(kind, folder, source):
    """Builds a wheel or an sdist, and returns its path."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", folder]
    subprocess.run(build, cwd=source, check=True)
    (path,) = folder.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return path


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The Python of an environment with a wheel of the sdist, and the unpacked sdist.

    The libraries are those of these tests. The sdist lacks the package itself, so that
    its tests meet the wheel.
    """
    folder = tmp_path_factory.mktemp("installed")
    sdist = _Build("sdist", folder, Path(__file__).parent.parent)
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    (source,) = (path for path in folder.iterdir() if path.is_dir())
    wheel = _Build("wheel", folder, source)
    shutil.rmtree(source / "teleop_drake")
    python = folder / "env/bin/python"
    venv.create(folder / "env")
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-index"]
    subprocess.run([*pip, "--no-deps", wheel], check=True)
    (packages,) = folder.glob("env/lib/*/site-packages")
    (packages / "tests.pth").write_text(sysconfig.get_path("purelib"))
    return python, source


def _RunOutside(command, folder):
    """Runs a command where only what is installed can be imported."""
    return subprocess.run(
        command,
        cwd=folder,
        env={x: y for x, y in os.environ.items() if x != "PYTHONPATH"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_an_installed_package_has_all_that_its_commands_need(installed, tmp_path):
    """From a wheel of the source archive, outside the source tree."""
    python, _ = installed
    folder = tmp_path / "empty"
    folder.mkdir()
    for command in INSTALLED.strip().splitlines():
        words = [python.with_name("teleop-drake"), *command.split()]
        run = _RunOutside(words, folder)
        assert run.returncode == 0, f"{command}: {run.stderr}"
        if command == "docs":
            assert str(python.parent.parent) in run.stdout
    assert {path.name for path in folder.iterdir()} == {
        *("run", "run.html", "compare", "sweep", "loop.svg", "replay.html"),
        *("loop.html", "page.html", "drive.html", "site"),
    }


@pytest.mark.slow
def test_the_source_archive_passes_its_tests(installed):
    """Against the wheel that is made of it."""
    python, source = installed
    code = "import teleop_drake; print(teleop_drake.__file__)"
    file = _RunOutside([python, "-P", "-c", code], source).stdout
    assert file.startswith(str(python.parent.parent))
    tests = [python, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", *SOME_TESTS]
    run = _RunOutside(tests, source)
    assert run.returncode == 0, run.stdout + run.stderr
