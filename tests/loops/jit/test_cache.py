"""Compiled code is kept for the same LLVM text, and made anew otherwise."""

import os
import time

import numpy as np
import pytest

from teleop_drake.loops.jit import compiled, native
from teleop_drake.loops.jit.compiled import CompiledLaw
from teleop_drake.loops.jit.native import Kept


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "teleop-drake" / "kernels"


def IsKept(code):
    """Returns whether it is there, and keeps it."""
    made = []

    def Make(code):
        made.append(code)
        return code.encode()

    assert Kept("thing", code, Make) == code.encode()
    return not made


def Files(folder):
    return {file for file in folder.rglob("*") if file.is_file()}


def test_it_is_kept_for_its_text_version_and_processor(monkeypatch):
    assert not IsKept("text")
    assert IsKept("text")
    assert not IsKept("another")
    monkeypatch.setattr(native, "_Version", lambda: "another version or processor")
    assert not IsKept("text")


@pytest.mark.parametrize("size", [0, 10, -1, None])
def test_a_damaged_file_is_made_anew(folder, size):
    assert not IsKept("text")
    (file,) = Files(folder)
    content = file.read_bytes()
    file.write_bytes(b"\0" * 99 if size is None else content[:size])
    assert not IsKept("text")
    assert file.read_bytes() == content
    assert IsKept("text")


def test_where_nothing_can_be_kept_it_is_made_each_time(folder):
    folder.parent.write_text("in the way")
    assert not IsKept("text")
    assert not IsKept("text")


def test_what_was_used_longest_ago_is_deleted(folder, monkeypatch):
    codes = [letter * 100 for letter in "abcd"]
    for age, code in enumerate(codes):
        IsKept(code)
        (new,) = (file for file in Files(folder) if code.encode() in file.read_bytes())
        os.utime(new, (time.time() - 100 + age,) * 2)
    assert IsKept(codes[0])  # Now it is the one that was used last.
    monkeypatch.setattr(native, "_MAX_BYTES", 3 * new.stat().st_size)
    IsKept("e" * 100)
    assert len(Files(folder)) == 3
    assert [IsKept(code) for code in (codes[0], codes[3])] == [True, True]


def test_laws_with_a_comprehension_or_a_lambda_are_found(folder, monkeypatch):
    monkeypatch.setattr(compiled, "_COMPILED_CALL", 1)

    def MakeLaws():
        yield lambda x: 3.125 * x
        yield lambda x: np.array([(lambda y: 7.375 * y)(y) for y in x])

    for _ in range(2):
        for law in MakeLaws():
            CompiledLaw(law)(np.array([1.0, 2.0]))
        assert len(Files(folder)) == 2
