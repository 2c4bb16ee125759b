"""Random diagrams: Drake, machine code and WebAssembly compute the same."""

from functools import partial

import numpy as np
import pytest
from engines import Compiled, InDrake, InWebAssembly
from pydrake.systems.analysis import SimulatorConfig
from random_diagrams import END, Random

# Not where packets and samplers act.
TIMES = (np.arange(12) + 1 / np.e) * END / 12


def AssertSame(seed, others=(InDrake,)):
    """Compares one diagram at the end of steps; returns how far Drake is from it.

    Drake locates an event within a microsecond, after which signals of size 1 differ by
    as much, and more where several follow on each other.
    """
    print(f"seed {seed}")
    config = SimulatorConfig(
        integration_scheme="runge_kutta5", max_step_size=0.01, accuracy=1e-9
    )
    machine, *found = (
        run(Random(seed).Make()[0], config, TIMES)
        for run in (partial(Compiled, as_machine_code=True), *others)
    )
    for run, other in zip(others, found, strict=True):
        tolerance = 1e-4 if run is InDrake else 1e-8
        errors = {name: np.abs(other[name] - machine[name]).max() for name in machine}
        name = max(errors, key=errors.get)
        assert errors[name] < tolerance, (seed, name, errors[name])
    return errors[name]


@pytest.mark.slow
def test_a_diagram_is_the_same_everywhere():
    assert AssertSame(105) < 1e-8


@pytest.mark.slow
def test_many_diagrams_are_the_same_everywhere():
    errors = [AssertSame(seed) for seed in range(110, 116)]
    errors += [AssertSame(seed, (InWebAssembly, InDrake)) for seed in range(100, 103)]
    assert np.median(errors) < 1e-6
