"""The package's data flows one way, and its files import accordingly."""

import ast
from pathlib import Path

import pytest

import teleop_drake

PACKAGE = Path(teleop_drake.__file__).parent

# A file imports only from what stands before it, or from its own folder.
ORDER = [
    "files",
    "kernel",
    "numerics",
    "channels",
    "laws",
    "environments",
    "systems",
    "robots",
    "scenario",
    "stations",
    "architectures",
    "teleoperator",
    "recording",
    "compiler",
    "tasks",
    "simulation",
    "analysis",
    "sweep",
    "figures",
    "thesis",
    "cli",
    "__main__",
]
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path.name != "__init__.py")


def Module(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def Imports(path: Path) -> set[str]:
    imports = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imports.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            assert node.module is not None
            imports.add(node.module)
    return imports


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_imports_follow_the_flow(path):
    mine = ORDER.index(Module(path))
    for name in Imports(path):
        assert name not in ("pydrake.all", "__future__"), name
        if name.startswith("teleop_drake."):
            theirs = name.split(".")[1]
            is_folder = (PACKAGE / ORDER[mine]).is_dir()
            allowed = ORDER[: mine + 1] if is_folder else ORDER[:mine]
            assert theirs in allowed, f"{path.name} imports {name}"


@pytest.mark.parametrize(
    "path", [p for p in FILES if Module(p) == "laws"], ids=lambda path: path.stem
)
def test_laws_are_free_of_drake(path):
    assert not any(name.startswith("pydrake") for name in Imports(path))


@pytest.mark.parametrize(
    "path", [p for p in FILES if Module(p) == "systems"], ids=lambda path: path.stem
)
def test_one_system_a_file(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    public = [
        node.name
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    assert public == ["".join(word.title() for word in path.stem.split("_"))]
