"""The Gaussian basis functions against closed forms and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from teleop_drake.model.laws.gaussian_network import (
    GaussianNetwork,
    equidistant_lattice,
    gaussian_functions,
)


def test_last_axis_of_the_lattice_varies_fastest():
    centres, spacing = equidistant_lattice([0.0, 10.0], [1.0, 30.0], [2, 3])
    assert_allclose(centres, [[0, 10], [0, 20], [0, 30], [1, 10], [1, 20], [1, 30]])
    assert_allclose(spacing, [1.0, 10.0])


def test_axis_with_one_centre():
    centres, spacing = equidistant_lattice([0.0, -1.0], [1.0, 5.0], [2, 1])
    assert_allclose(centres, [[0, 2], [1, 2]])
    assert_allclose(spacing, [1.0, 6.0])


def test_values_of_one_axis():
    network = GaussianNetwork(lower=[0.0], upper=[2.0], count=[3], width=0.5)
    assert (network.num_inputs, network.num_functions) == (1, 3)
    assert_allclose(network.widths, [0.5])
    # (3.1) has no factor 1/2: at one width from the centre a function is 1/e.
    assert_allclose(
        network.evaluate(np.array([0.5])),
        [math.exp(-1.0), math.exp(-1.0), math.exp(-9.0)],
    )
    assert_allclose(network.evaluate(np.array([1.0]))[1], 1.0)


def test_values_of_two_axes_by_hand():
    network = GaussianNetwork(
        lower=[0.85, -0.15], upper=[1.15, 0.15], count=[3, 2], width=2.0
    )
    u = np.array([0.9, 0.05])
    expected = [
        math.exp(-(((u[0] - x) / 0.3) ** 2) - ((u[1] - y) / 0.6) ** 2)
        for x in (0.85, 1.0, 1.15)
        for y in (-0.15, 0.15)
    ]
    assert_allclose(network.evaluate(u), expected, rtol=1e-12)


@pytest.mark.parametrize("m", [1, 3])
@given(seed=st.integers(0, 2**32 - 1))
def test_rate_against_finite_differences(m, seed):
    rng = np.random.default_rng(seed)
    network = GaussianNetwork(
        lower=[-1.0] * m,
        upper=[1.0, 2.0, 3.0][:m],
        count=rng.integers(1, 5, m),
        width=rng.uniform(0.5, 2.0),
    )
    u = rng.uniform(-2, 2, m)
    u_dot = rng.uniform(-3, 3, m)
    Phi, Phi_dot = gaussian_functions(u, u_dot, *network.as_numbers())
    assert_allclose(Phi, network.evaluate(u), rtol=1e-13)
    assert Phi.shape == (network.num_functions,)
    h = 1e-5
    difference = network.evaluate(u + h * u_dot) - network.evaluate(u - h * u_dot)
    assert_allclose(Phi_dot, difference / (2 * h), atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lower": [0.0]}, r"^lower, upper = .*must be vectors of one size"),
        ({"lower": [], "upper": [], "count": []}, "^lower, upper = "),
        ({"lower": [0.0, 1.0]}, "must be finite, lower less than upper"),
        ({"upper": [1.0, float("inf")]}, "must be finite, lower less"),
        ({"count": [3]}, r"^count = \[3\]: must be 2 whole numbers"),
        ({"count": [3, 0]}, r"^count = \[3, 0\]: must be 2 whole numbers >= 1"),
        ({"count": [3, 2.5]}, "^count = .*must be 2 whole numbers"),
        ({"width": 0.0}, "^width = 0.0: must be a finite number > 0"),
    ],
)
def test_bad_arguments(change, message):
    arguments = {"lower": [0, 0], "upper": [1, 1], "count": [2, 2], "width": 1.0}
    with pytest.raises(ValueError, match=message):
        GaussianNetwork(**(arguments | change))


def test_arrays_are_read_only():
    network = GaussianNetwork(lower=[0.0], upper=[1.0], count=[2], width=1.0)
    for array in (network.centres, network.widths):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 3.0
