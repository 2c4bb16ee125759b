"""WebAssembly of a run against its native run."""

import numpy as np
import pytest
from wasm_runs import RunModule

from teleop_drake.numerics.step_polynomials import interpolate
from teleop_drake.page.model import ModelOf
from teleop_drake.scenario import ARCHITECTURES, LoadScenario, ScenarioNames
from teleop_drake.simulation import simulate

# What one of them compiles, the others find on the disk.
pytestmark = pytest.mark.xdist_group("machine_code")


def AssertSame(scenario):
    """Compares jumps, and signals halfway between the rows that both runs have."""
    model, native = ModelOf(scenario), simulate(scenario, engine="compiled")
    times, rows, steps = RunModule(model)
    jumps, native_jumps = (t[1:][np.diff(t) == 0] for t in (times, native.time))
    assert jumps == pytest.approx(native_jumps, rel=0, abs=1e-9)
    ports, looked = model.Ports(), np.linspace(0.0, times[-1], 400)
    for name, port in model.Signals().items():
        begin, size, _ = ports[port]
        signal = interpolate(times, rows[:, begin : begin + size], steps, looked)
        reference = native.Interpolate(name, looked)
        error = np.abs(signal - reference).max(initial=0.0)
        assert error <= 1e-6 * max(np.ptp(native[name]), 1e-9), name


def test_it_is_the_native_run():
    AssertSame(LoadScenario("one_dof"))


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(ScenarioNames()))
def test_every_scenario(name):
    AssertSame(LoadScenario(name))


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(ARCHITECTURES))
def test_every_architecture(kind):
    AssertSame(LoadScenario("one_dof", {"controller.kind": kind}))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("variable", {"sinusoid": {"amplitude": 0.03, "frequency": 2.0}}),
        ("sampled", {"sample_period": 0.01}),
        ("network", {"sample_period": 0.01, "seed": 3}),
    ],
)
def test_every_channel(kind, more):
    channel = {"kind": kind, "delay": 0.1, **more}
    channels = {f"{way}_channel": channel for way in ("forward", "return")}
    AssertSame(LoadScenario("one_dof", channels))
