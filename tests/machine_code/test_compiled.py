"""Compiled laws give the numbers of the laws."""

import json
import subprocess
import sys

import numba
import numpy as np
import pytest
from grids import Slow

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
from teleop_drake.machine_code.compiled import compiled
from teleop_drake.numerics.interpolation import (
    evaluate_newton,
    limited_polynomial,
    newton_polynomial,
)
from teleop_drake.scenario import LayerConfig

NUM_FUNCTIONS = 7


def assert_same(law, *arguments):
    fast = compiled(law)
    assert isinstance(fast.dispatcher, numba.core.dispatcher.Dispatcher)
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
        arrays = gains.as_arrays()
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
    layers[-1].lateral_stiffness = 3.0
    table, regions = layer_table(layers), layer_regions(layers)
    assert regions.tolist() == [[0, 0], [1, 1], [2, 2], [3, 3]]
    axis = np.array([[0.6, 0.8], [1.0, -2.0]])
    for p, v in rng.uniform(-1, 3, size=(20, 2, 2)):
        for region in range(4):
            assert_same(layered_force, table, regions, region, axis, p, v)
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
        assert_same(limited_polynomial, times, values, i)
        polynomials = newton_polynomial(times, values, i)
        time = (times[i] + times[i + 1]) / 2
        assert_same(evaluate_newton, polynomials, time)


RUN = """
import json, sys
if sys.argv[1] == "without":
    sys.modules["numba"] = None  # As if it were not installed.
import numpy as np
from teleop_drake.machine_code.compiled import compiled
from teleop_drake.numerics.interpolation import limited_polynomial
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.tasks.metrics import RunMetrics
assert (compiled(limited_polynomial) is limited_polynomial) == ("without" in sys.argv)
for name, overrides in json.loads(sys.argv[2]):
    recording = simulate(LoadScenario(name, overrides))
    metrics = RunMetrics(recording)
    # Error control may end a step of the same kind 1e-11 s later.
    times = np.linspace(0, recording.time[-1], 500)
    print(
        len(recording.time),
        *recording.Interpolate("tool_velocity", times).ravel(),
        *recording.Interpolate("control_force", times).ravel(),
        *metrics["control_force_peak"],
        *metrics["control_force_variation"],
    )
"""

# Sampled channels make passivity control brake and let go in quick succession.
SAMPLED = {"kind": "sampled", "delay": 0.1, "sample_period": 0.05}
RUNS = {
    "passivity over sampled channels": (
        "two_dof_combined",
        {
            "controller.kind": "time_domain_passivity",
            "duration": 2.5,
            "forward_channel": SAMPLED,
            "return_channel": SAMPLED,
        },
    ),
    "backstepping, arm": ("two_dof_combined", {"duration": 1.0}),
    "backstepping, slider": ("one_dof", {"duration": 2.0}),
    "waves": (
        "two_dof_collision",
        {"controller.kind": "wave_variables", "duration": 1.5},
    ),
}


@pytest.fixture(scope="module", params=Slow([0.4, 1.0]))
def whole_runs(request):
    """Every run with numba and without it; the short run of the tests has a part."""
    runs = [
        (name, values | {"duration": request.param * values["duration"]})
        for name, values in RUNS.values()
    ]
    return [
        subprocess.run(
            [sys.executable, "-c", RUN, which, json.dumps(runs)],
            stdout=subprocess.PIPE,
            check=True,
            text=True,
        ).stdout.splitlines()
        for which in ("with", "without")
    ]


@pytest.mark.xdist_group("without_numba")
@pytest.mark.parametrize("number, name", list(enumerate(RUNS)))
def test_a_run_without_numba_is_the_same(whole_runs, number, name):
    """And so are as many steps, which error control chooses."""
    with_numba, without = (
        np.array(lines[number].split(), dtype=float) for lines in whole_runs
    )
    np.testing.assert_allclose(with_numba, without, rtol=0, atol=1e-12)


def test_it_is_optional(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    law = compiled.__wrapped__(gaussian_functions)
    assert law is gaussian_functions
