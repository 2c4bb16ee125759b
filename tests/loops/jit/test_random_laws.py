"""Random laws compute in machine code what they compute in Python."""

import warnings

import numpy as np
import pytest
from random_laws import RandomLaw

from teleop_drake.loops.jit.native import BoundEvaluate, Library, ObjectFile
from teleop_drake.loops.jit.packing import Place
from teleop_drake.loops.jit.scalar_code import MakeCode, TraceLaw
from teleop_drake.loops.jit.symbols import Untraceable


def IsSame(seed):
    """Compares one law at 12 points; returns whether it is one that is compiled.

    At two points the last digits may decide which way a law goes.
    """
    law, text = RandomLaw(seed)
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(12, 6)) * np.tile([[0.7], [1.5]], (6, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = [np.asarray(law(x.copy()), float) for x in points]
        try:
            program = TraceLaw(law, [Place(0, (6,))], 6)
        except Untraceable:
            return False
    memory = np.zeros(6)
    result = np.zeros(len(program.stores))
    library = Library(ObjectFile(MakeCode(program)), "evaluate")
    call = BoundEvaluate(library, memory, result)
    num_others = 0
    for x, values in zip(points, expected, strict=True):
        memory[:] = x
        call()
        num_others += not np.allclose(result, values, rtol=1e-9, atol=1e-9)
    assert num_others <= 2, f"seed {seed}\n{text}"
    return True


def test_random_laws():
    assert sum(map(IsSame, range(1000, 1012))) > 6


@pytest.mark.slow
def test_many_random_laws():
    seeds = range(300)
    print(f"seeds {seeds}")
    assert sum(map(IsSame, seeds)) > 0.8 * len(seeds)
