"""What is compiled is kept, and made anew when anything that it depends on changes."""

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from teleop_drake.machine_code import cache
from teleop_drake.machine_code.cache import Kept

FACTOR = 2.0
TABLE = np.array([1.0, 2.0])


def helper(x):
    return FACTOR * x


def function(x, power=2):
    return helper(x) ** power + TABLE[0]


def around(gain):
    def inner(x):
        return gain * x

    return inner


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    return tmp_path


def IsKept(*functions, text="text"):
    """Returns whether it is there, and keeps it."""
    data, was_there = Kept("thing", text, functions, lambda: b"data")
    assert data == b"data"
    return was_there


def test_it_is_kept_until_something_changes(monkeypatch):
    assert not IsKept(function)
    assert IsKept(function)
    assert not IsKept(function, text="another")
    for name, value in (
        ("FACTOR", 3.0),  # Of a helper.
        ("TABLE", np.array([1.0, 2.5])),
        ("helper", lambda x: x),
    ):
        monkeypatch.setitem(globals(), name, value)
        assert not IsKept(function), name
        assert IsKept(function), name
    monkeypatch.setattr(function, "__defaults__", (3,))
    assert not IsKept(function)
    monkeypatch.setattr(cache, "_Compilers", lambda: b"another version")
    assert not IsKept(function)
    monkeypatch.setattr(cache, "Processor", lambda: "another processor")
    assert not IsKept(function)


def test_functions_with_the_same_text_are_told_apart():
    assert not IsKept(around(2.0))
    assert not IsKept(around(3.0))
    assert not IsKept(around(np.array([2.0])))
    assert IsKept(around(2.0))
    first, second = (lambda x: x), (lambda x: 2 * x)
    assert not IsKept(first)
    assert not IsKept(second)


def test_where_nothing_can_be_kept_it_is_made_each_time(folder):
    (folder / "teleop-drake").write_text("in the way")
    assert not IsKept(function)
    assert not IsKept(function)
