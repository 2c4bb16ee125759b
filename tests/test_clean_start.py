"""The README from nothing: no package, no cache, no compiler, no dot, no Chromium.

The oldest and the newest Python for which Drake has wheels start with an empty home and
a PATH that has nothing but itself and a shell. The commands are those of the README.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from documentation import README

TEXT = README.read_text(encoding="utf-8")
SET_UP = re.findall(r"^```sh\n(.*?)\n```$", TEXT, re.MULTILINE | re.DOTALL)[0]

# What a newcomer tries next, from the README.
NEXT = [
    "teleop-drake compare one_dof --vary delay=0.05,0.1,0.2 --format pdf",
    "teleop-drake sweep one_dof --delay 0:0.4:9 --out sweep",
    "teleop-drake page two_dof_combined -o loop.html",
    "teleop-drake diagram two_dof_combined -o loop.svg",
    "teleop-drake analyze one_dof",
]


def _Pythons():
    """The Pythons of this machine for which Drake has wheels, by their versions."""
    found = {}
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    for path in [
        Path(sys.executable).resolve(),
        *root.glob("versions/3.*/bin/python3"),
    ]:
        code = "import sys; print('%d.%d' % sys.version_info[:2])"
        run = subprocess.run(
            [path, "-c", code], capture_output=True, text=True, check=False
        )
        version = run.stdout.strip()
        if version in ("3.11", "3.13"):
            found.setdefault(version, path)
    return found


PYTHONS = _Pythons()


class Newcomer:
    """Somebody whose home is empty, and whose PATH has a Python and a shell."""

    def __init__(self, folder: Path, python: Path):
        self.folder = folder
        (folder / "bin").mkdir(parents=True)
        (folder / "home").mkdir()
        (folder / "bin/python3").symlink_to(python)
        for name in ("sh", "env", "uname"):
            (folder / "bin" / name).symlink_to(shutil.which(name))
        keep = {x: y for x, y in os.environ.items() if x.startswith(("PIP_", "SSL_"))}
        self.environment = keep | {
            "HOME": str(folder / "home"),
            "PATH": str(folder / "bin"),
            "PIP_NO_CACHE_DIR": "1",
            "MPLBACKEND": "Agg",
        }

    def Run(self, command: str, cwd: Path) -> None:
        """Runs a command by the shell."""
        run = subprocess.run(
            ["sh", "-c", command],
            cwd=cwd,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, f"{command}: {run.stdout}{run.stderr}"


@pytest.mark.slow
@pytest.mark.parametrize("version", PYTHONS)
def test_the_readme_from_top_to_bottom(version, tmp_path):
    newcomer = Newcomer(tmp_path, PYTHONS[version])
    for program in ("cc", "gcc", "dot", "chromium", "google-chrome", "git"):
        assert shutil.which(program, path=newcomer.environment["PATH"]) is None
    clone = tmp_path / "clone"
    ignored = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".hypothesis")
    shutil.copytree(README.parent, clone, ignore=ignored)
    newcomer.Run(SET_UP, clone)
    assert (clone / "out/two_dof_combined_comparison.png").stat().st_size > 10_000
    activate = ". .venv/bin/activate && "
    for command in NEXT:
        assert f"`{command}`" in re.sub(r"\s+", " ", TEXT), command
        newcomer.Run(activate + command, clone)
    assert (clone / "loop.svg").stat().st_size > 5_000
    assert (clone / "loop.html").stat().st_size > 50_000


def test_a_python_is_found():
    assert PYTHONS
