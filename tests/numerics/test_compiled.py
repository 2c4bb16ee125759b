"""Compiled laws give the numbers of the laws."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from teleop_drake.laws.backstepping import (
    BacksteppingGains,
    backstepping_error_vector,
    backstepping_rate_vector,
    state_size,
    unpack_state,
)
from teleop_drake.laws.gaussian_network import (
    GaussianNetwork,
    gaussian_functions,
)
from teleop_drake.laws.layered_force import (
    layer_regions,
    layer_row,
    layer_table,
    layered_force,
)
from teleop_drake.laws.task_space import joint_torques, tool_kinematics
from teleop_drake.numerics.compiled import compiled
from teleop_drake.numerics.interpolation import (
    evaluate_newton,
    newton_polynomial,
    newton_polynomials,
)
from teleop_drake.scenario import LayerConfig

NUM_FUNCTIONS = 7


def assert_same(law, *arguments):
    fast = compiled(law)
    assert isinstance(fast, numba.core.dispatcher.Dispatcher)
    results, expected = fast(*arguments), law(*arguments)
    if not isinstance(expected, tuple):
        results, expected = (results,), (expected,)
    for result, value in zip(results, expected, strict=True):
        scale = max(np.max(np.abs(value)), 1.0)
        np.testing.assert_allclose(result, value, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("is_at_limit", [False, True])
def test_backstepping(n, is_at_limit):
    rng = np.random.default_rng(n)
    I = np.eye(n)
    gains = BacksteppingGains(
        Lambda=1.5 * I,
        G1=4 * I,
        G2=30 * I,
        P=2 * I,
        beta1=0.1,
        beta2=0.2,
        beta3=0.3,
        nu1=0.4,
        nu3=0.5,
        Upsilon=0.6,
        Psi0=4 * I + 0.1,
        Psi_min=2.0 if is_at_limit else 0.1,
    )
    for _ in range(20):
        x = rng.normal(size=state_size(n, NUM_FUNCTIONS))
        unpack_state(x, n).Psi[:] = 1.9 * I + 0.1 * rng.normal(size=(n, n))
        signals = rng.normal(size=(4, n))
        Phi, Phi_dot = rng.normal(size=(2, NUM_FUNCTIONS))
        arrays = gains.AsArrays()
        assert_same(backstepping_rate_vector, *arrays, x, Phi, Phi_dot, *signals)
        assert_same(backstepping_error_vector, *arrays, x, Phi, *signals)


def test_task_space():
    rng = np.random.default_rng(0)
    for n in (1, 2, 3):
        p, x, J = rng.normal(size=3), rng.normal(size=9), rng.normal(size=(3, 4))
        assert_same(tool_kinematics, p, J, x, n)
        F_c, F_e = rng.normal(size=(2, n))
        assert_same(joint_torques, F_c, F_e, rng.normal(size=n * (2 + 4)))


def test_layered_force():
    rng = np.random.default_rng(0)
    layers = [
        LayerConfig(name="a", start=0.0, stiffness=9.0, reference=0.1, damping=2.0),
        LayerConfig(name="b", start=1.0, stiffness=5.0, reference=1.0, damping=0.0),
        LayerConfig(name="c", start=2.0, stiffness=7.0, reference=2.0, damping=1.0),
    ]
    table, regions = layer_table(layers), layer_regions(layers)
    assert regions.tolist() == [[0, 0], [1, 1], [2, 2], [3, 3]]
    for p, v in rng.uniform(-1, 3, size=(20, 2, 2)):
        for region in range(4):
            assert_same(layered_force, table, regions, region, p, v)
            assert_same(layer_row, table, regions, region, p[0])


def test_gaussian_functions():
    rng = np.random.default_rng(0)
    network = GaussianNetwork(lower=[0, 0], upper=[1, 2], count=[3, 4], width=1.2)
    for u, u_dot in rng.normal(size=(20, 2, 2)):
        assert_same(gaussian_functions, u, u_dot, network.centres, network.widths)


@pytest.mark.parametrize("num_samples", [2, 5, 14])
def test_interpolation(num_samples):
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.5, 1.5, num_samples))
    values = rng.normal(size=(num_samples, 3))
    for i in range(num_samples - 1):
        assert_same(newton_polynomial, times, values, i)
        polynomials = newton_polynomial(times, values, i)
        time = (times[i] + times[i + 1]) / 2
        assert_same(evaluate_newton, polynomials, time)
    times[1] = times[0]  # A jump.
    assert_same(newton_polynomials, times, values, np.arange(num_samples - 1))


RUN = """
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
# Error control would choose other steps at a difference in the last digit.
fixed = {"duration": 1.0, "simulator.use_error_control": False}
recording = simulate(LoadScenario("two_dof_combined", fixed))
print(*recording["tool_velocity"].ravel(), *recording["control_force"].ravel())
"""


def test_a_run_without_numba_is_the_same():
    signals = [
        np.array(
            subprocess.run(
                [sys.executable, "-c", RUN],
                env=os.environ | {"NUMBA_DISABLE_JIT": disable},
                stdout=subprocess.PIPE,
                check=True,
                text=True,
            ).stdout.split(),
            dtype=float,
        )
        for disable in "01"
    ]
    np.testing.assert_allclose(*signals, rtol=0, atol=1e-12)


def test_it_is_optional(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    law = compiled.__wrapped__(gaussian_functions)
    assert law is gaussian_functions
