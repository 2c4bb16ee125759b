"""The package's data flows one way, and its files import accordingly."""

import ast
import functools
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import teleop_drake

# They read the same files.
pytestmark = pytest.mark.xdist_group("architecture")

PACKAGE = Path(teleop_drake.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))


def Module(path: Path) -> str:
    """Returns the dotted name of a file; a folder's __init__.py has the folder's."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


FLOORS = ("loops", "model", "study", "thesis", "cli")
"""The floors of the package, the lowest one first."""


def Floor(module: str) -> str:
    """Returns the floor of a module; the root's files stand above all floors."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and parts[1] in FLOORS else "root"


def Room(module: str) -> str:
    """Returns the folder of a floor, or of blocks/, that a module belongs to."""
    parts = module.split(".")
    depth = 4 if parts[1:3] == ["model", "blocks"] else 3
    return ".".join(parts[:depth])


# Several tests look at the same files.
@functools.cache
def Nodes(source: str) -> list[ast.AST]:
    """Returns the syntax of a file that the tests ask about, the file itself first."""
    kinds = (
        ast.Module,
        ast.Import,
        ast.ImportFrom,
        ast.Call,
        ast.FunctionDef,
        ast.Constant,
    )
    return [node for node in ast.walk(ast.parse(source)) if isinstance(node, kinds)]


@functools.cache
def Source(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def NamedModules(source: str) -> set[str]:
    """Returns the modules of the package that the strings of a file name.

    Such a string is `teleop_drake.room.file`, `teleop_drake.room.file:Name` or, without
    the package, `room.file:Name`. A string like `teleop_drake.cli.commands.`, to which
    a file's name is added, names the folder.
    """
    named = set()
    for node in Nodes(source):
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
            continue
        module, colon, _ = node.value.partition(":")
        module = module.rstrip(".")
        candidates = [module, f"teleop_drake.{module}"] if colon else [module]
        named.update(name for name in candidates if name in MODULES)
    return named - {"teleop_drake"}


def NameBegin(name: ast.expr) -> str:
    """Returns the part of a module's name that a file tells."""
    if isinstance(name, ast.JoinedStr):
        name = name.values[0]
    return str(name.value) if isinstance(name, ast.Constant) else ""


def ImportsUnknownModules(source: str) -> bool:
    """Returns whether a file imports modules of which it does not tell the room."""
    importers = ("import_module", "importlib.import_module", "__import__")
    return any(
        isinstance(node, ast.Call)
        and ast.unparse(node.func) in importers
        and NameBegin(node.args[0]).rstrip(".") in ("", "teleop_drake")
        for node in Nodes(source)
    )


def Imports(path: Path) -> set[str]:
    """Returns the modules that a file imports, anywhere in it, or names in strings."""
    # A file that names its own folder reads the data beside it.
    imports = NamedModules(Source(path)) - {Module(path.parent / "__init__.py")}
    for node in Nodes(Source(path)):
        if isinstance(node, ast.Import):
            imports.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            assert node.module is not None
            imports.add(node.module)
            # `from folder import file` imports the file.
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            imports.update(names & MODULES)
    return imports


MODULES = {Module(path) for path in FILES}


@functools.cache
def AllImports() -> dict[str, set[str]]:
    """Returns what each module of the package imports."""
    return {Module(path): Imports(path) for path in FILES}


@functools.cache
def TopImports(module: str) -> set[str]:
    """Returns the modules of the package that a file imports outside of functions."""
    path = PACKAGE.parent / f"{module.replace('.', '/')}.py"
    if not path.exists():
        path = path.with_suffix("") / "__init__.py"
    found = set()
    for node in ast.parse(Source(path)).body:
        if isinstance(node, ast.ImportFrom):
            found |= {node.module, *(f"{node.module}.{x.name}" for x in node.names)}
    return (found & MODULES) - {module}


def ImportedWith(module: str) -> set[str]:
    """Returns the modules that a module imports, and the folders that they are in."""
    found = TopImports(module)
    for name in found:
        parts = name.split(".")
        found = found | {".".join(parts[:i]) for i in range(2, len(parts))}
    return found


def AssertNoCircle(graph: dict[str, set[str]]) -> None:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def UpwardImports(graph: dict[str, set[str]]) -> list[tuple[str, str]]:
    """Returns the pairs of a module and one of a higher floor that it imports."""
    order = [*FLOORS, "root"]
    return [
        (module, name)
        for module, imports in graph.items()
        for name in imports & MODULES
        if order.index(Floor(name)) > order.index(Floor(module))
    ]


def test_no_import_runs_up():
    assert UpwardImports(AllImports()) == []


def test_upward_imports_are_found():
    up = {"teleop_drake.loops.run": {"teleop_drake.model.run", "teleop_drake.loops"}}
    assert UpwardImports(up) == [("teleop_drake.loops.run", "teleop_drake.model.run")]
    root = {"teleop_drake.cli.main": {"teleop_drake"}}
    assert UpwardImports(root) == [("teleop_drake.cli.main", "teleop_drake")]


def test_rooms_stand_on_each_other():
    """The rooms of a floor do not import each other in circles.

    Not counted are imports within functions, by which what shows a thing is called from
    the thing that is shown.
    """
    rooms: dict[str, set[str]] = {}
    for module in MODULES:
        below = rooms.setdefault(Room(module), set())
        below |= {Room(name) for name in TopImports(module)} - {Room(module)}
    inner = set(rooms) - {"teleop_drake", *(f"teleop_drake.{x}" for x in FLOORS)}
    AssertNoCircle({room: rooms[room] & inner for room in inner})


def test_files_do_not_import_in_circles():
    AssertNoCircle({module: TopImports(module) for module in MODULES})


def test_circles_are_found():
    with pytest.raises(pytest.fail.Exception, match=r"(a imports b|b imports a)"):
        AssertNoCircle({"a": {"b"}, "b": {"a"}})


def test_imports_by_strings_are_found():
    assert NamedModules("import_module('teleop_drake.loops.page').A") == {
        "teleop_drake.loops.page"
    }
    assert NamedModules("F('study.figures.runs:PlotRun')") == {
        "teleop_drake.study.figures.runs"
    }
    commands = "import_module(f'teleop_drake.cli.commands.{name}')"
    assert NamedModules(commands) == {"teleop_drake.cli.commands"}
    assert not ImportsUnknownModules(commands)
    assert NamedModules("F('page', 'a: b')") == set()


@pytest.mark.parametrize("name", ["module", "f'teleop_drake.{x}'", "'teleop_drake'"])
def test_imports_of_unknown_modules_are_found(name):
    assert ImportsUnknownModules(f"importlib.import_module({name})")


def test_unknown_modules_are_those_of_the_user():
    """The tables of public names are exceptions: they stand above all rooms.

    A kind of a user's own is in a user's module, and so is what a user's law imports.
    """
    found = [
        str(path.relative_to(PACKAGE))
        for path in FILES
        if ImportsUnknownModules(Source(path))
    ]
    assert found == [
        "loops/__init__.py",
        "loops/jit/following.py",
        "model/kinds.py",
        "moved.py",
    ]


def AllImportedWith(module: str) -> set[str]:
    """Returns the modules that are imported with a module, directly or not."""
    known: set[str] = set()
    waiting = {f"teleop_drake.{module}"}
    while waiting:
        known |= waiting
        waiting = set().union(*map(ImportedWith, waiting)) - known
    return known


@pytest.mark.parametrize("module", ["model.run.simulate", "study.page.page"])
def test_what_takes_a_system_imports_scenarios_when_needed(module):
    found = AllImportedWith(module)
    assert "teleop_drake.loops.framework.signals" in found
    assert not [x for x in found if x.startswith("teleop_drake.model.scenario")]


# Mathematics: no Drake, names in snake_case.
OF_NUMBERS = ("model.laws", "loops.numerics", "study.numerics")


def test_imports_are_narrow():
    for module, imports in AllImports().items():
        assert not imports & {"pydrake.all", "__future__"}, module
        room = Room(module).removeprefix("teleop_drake.")
        if room in OF_NUMBERS or module.endswith((".validation", ".kinds", ".files")):
            assert not any(name.startswith("pydrake") for name in imports), module


@pytest.mark.parametrize(
    "path", [p for p in FILES if p.parent.name == "systems"], ids=lambda path: path.stem
)
def test_one_system_a_file(path):
    public = [
        node.name
        for node in Nodes(Source(path))[0].body
        if isinstance(node, ast.ClassDef)
        and not node.name.startswith("_")
        and not node.name.endswith("Config")
    ]
    expected = "".join(word.title() for word in path.stem.split("_"))
    # The gears' friction is a part of the drive.
    others = ["GearFriction"] if path.stem == "actuator" else []
    assert public == ([] if path.stem == "__init__" else [*others, expected])


def AsksForAScenario(source: str) -> bool:
    """Returns whether a file asks which class a scenario is of."""
    return any(
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "isinstance"
        and re.search(r"\b(Tracking)?Scenario\b", ast.unparse(node.args[1]))
        for node in Nodes(source)
    )


OF_SCENARIOS = ("teleop_drake.model.scenario", "teleop_drake.model.tasks")


def test_only_scenarios_and_tasks_ask_what_a_scenario_is():
    asking = [
        str(path.relative_to(PACKAGE))
        for path in FILES
        if Room(Module(path)) not in OF_SCENARIOS and AsksForAScenario(Source(path))
    ]
    assert asking == []
    assert AsksForAScenario("isinstance(x, Scenario | int)")
    assert not AsksForAScenario("isinstance(x, ScenarioError)")


MIRRORED = (
    "systems",
    "delays",
    "environments",
    "operators",
    "architectures",
    "robots",
    "numerics",
)


def test_every_block_has_a_test():
    """In a file of its name, or in one that imports it; so have laws with them."""
    tests = {path: Source(path) for path in Path(__file__).parent.rglob("*.py")}
    for path in FILES:
        name = path.relative_to(PACKAGE)
        if path.parent.name in MIRRORED and path.stem != "__init__":
            module = ".".join(["teleop_drake", *name.with_suffix("").parts])
            has_own = any(test.name == f"test_{path.name}" for test in tests)
            assert has_own or any(module in text for text in tests.values()), module


# What Python's import, Drake, argparse, PyYAML, ast, concurrent.futures, http.server
# and socketserver call by these names, what IPython asks for, what users of pandas,
# SciPy and python-control expect, and what users of the first version call.
OTHERS_NAMES = (
    "main|error|parse_known_args|visit_\\w+|construct_\\w+|repr_\\w+|submit|shutdown"
    "|do_GET|log_message|handle|setup|find_spec|create_module|exec_module"
    "|add_subplot|_construct|_construct_copy|[sgc]\\w+_monitor|_(repr|ipython)_\\w+_|plot|to_dataframe|simulate"
    "|bode|margins|to_control"
)
SNAKE_CASE = r"_*([a-z][a-z0-9]*|[A-Z])(_[a-zA-Z0-9]+)*"
CAMEL_CASE = r"_?([A-Z][a-z0-9]*)+_?"


def MisnamedFunctions(path: Path, source: str) -> list[str]:
    """Returns the functions of a file whose names are not those of its folder.

    Functions of numbers are in snake_case: laws, numerics, and what kernels and the
    integrator consist of, in kernel/, engine/, jit/ and beside the block.
    Properties are in snake_case as well. Everything that touches Drake is in CamelCase.
    """
    nodes = Nodes(source)
    room = ".".join(path.relative_to(PACKAGE).parts[:2])
    offers_terms = "Kernel(" in source or "ModalOperator.__init__(" in source
    misnamed = []
    for node in nodes:
        if not isinstance(node, ast.FunctionDef) or node.name.startswith("__"):
            continue
        is_property = any("property" in ast.unparse(x) for x in node.decorator_list)
        if room in OF_NUMBERS or is_property:
            allowed = SNAKE_CASE
        elif (offers_terms and node in nodes[0].body) or room in (
            "loops.kernel",
            "loops.engine",
            "loops.jit",
        ):
            allowed = f"{SNAKE_CASE}|{CAMEL_CASE}"
        else:
            allowed = f"{CAMEL_CASE}|{OTHERS_NAMES}"
        if not re.fullmatch(allowed, node.name):
            misnamed.append(node.name)
    return misnamed


def test_names_of_functions():
    misnamed = {
        str(path.relative_to(PACKAGE)): MisnamedFunctions(path, Source(path))
        for path in FILES
    }
    assert {path: names for path, names in misnamed.items() if names} == {}


def test_misnamed_functions_are_found():
    assert MisnamedFunctions(PACKAGE / "model/laws/a.py", "def GetRoot(): ...")
    assert MisnamedFunctions(PACKAGE / "study/sweep/a.py", "def get_root(): ...")


MOST_LINES_OF_A_FUNCTION = 60
MOST_LINES_OF_A_FILE = 500


def LongFunctions(source: str) -> list[str]:
    """Returns the functions that are too long, their docstrings not counted."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.FunctionDef):
            continue
        lines = node.end_lineno - node.lineno + 1
        if ast.get_docstring(node, clean=False) is not None:
            lines -= node.body[0].end_lineno - node.body[0].lineno + 1
        if lines > MOST_LINES_OF_A_FUNCTION:
            found.append(f"{node.name}: {lines} lines")
    return found


def test_no_function_is_longer_than_a_screen():
    long = {path: found for path in FILES if (found := LongFunctions(Source(path)))}
    assert not long


def test_no_file_is_too_long():
    long = [x for x in FILES if Source(x).count("\n") > MOST_LINES_OF_A_FILE]
    assert not long


def test_long_functions_are_found():
    """A docstring does not count, and a line more is too long."""
    body = "    pass\n" * (MOST_LINES_OF_A_FUNCTION - 1)
    text = 'def F():\n    """One.\n\n    Two.\n    """\n' + body
    assert LongFunctions(text) == []
    assert LongFunctions(text + "    pass\n") == ["F: 61 lines"]
