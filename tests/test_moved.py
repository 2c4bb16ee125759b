"""Modules of earlier versions are found under their old names."""

import subprocess
import sys
import warnings
from importlib import import_module

import pytest

import teleop_drake
from teleop_drake import moved

PLACES = {x: y for x, y in moved._PLACES.items() if x not in moved._NAMES}


@pytest.mark.parametrize("old", PLACES)
def test_an_old_name_is_the_new_module(old):
    new = import_module(f"teleop_drake.{PLACES[old]}")
    spec = new.__spec__
    sys.modules.pop(f"teleop_drake.{old}", None)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        found = import_module(f"teleop_drake.{old}")
    assert found is new
    # The room above may have moved, too.
    assert str(seen[-1].message).endswith(
        f"{old} has moved: import from {new.__name__}"
    )
    assert new.__spec__ is spec
    assert new.__name__ == f"teleop_drake.{PLACES[old]}"


CODE = """
import warnings
warnings.simplefilter("ignore", DeprecationWarning)
import teleop_drake.kernel.linear_part as part
from teleop_drake.blocks.channels.trace import Trace
from teleop_drake.simulation import drake_run, simulate
from teleop_drake.page import WritePage
import teleop_drake
import teleop_drake.loops.kernel.linear_part as new
assert part is new
assert simulate is teleop_drake.simulate and WritePage is teleop_drake.WritePage
assert drake_run.__name__ == "teleop_drake.loops.run.drake_run"
assert Trace.__module__ == "teleop_drake.model.channels.trace"
"""


def test_scripts_of_earlier_versions_run():
    subprocess.run([sys.executable, "-c", CODE], check=True)


def test_other_names_are_unknown():
    assert moved.NewName("numpy.kernel") is None
    with pytest.raises(ModuleNotFoundError, match=r"teleop_drake\.nothing"):
        import_module("teleop_drake.nothing")
    assert "FindMoved" not in dir(teleop_drake)
