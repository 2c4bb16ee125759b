"""Sweeps of a System: x' = -k x(t - T) from x = 1, whose solution is a polynomial."""

import math
import pickle
import threading
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import Gain, Integrator, RandomSource
from wired import Wired

from teleop_drake import ScenarioError, Sweep, TransportDelay
from teleop_drake.loops.run.compiled_system import CompiledSystem

DELAYS = [0.0, 0.2, 0.5, 1.5]
GRID = {"sensor.delay": DELAYS, "gain.k": [-1.0, -2.0]}


def MakeLoop():
    """The loop with the Context where it begins."""
    diagram = Wired(
        {
            "plant": Integrator(1),
            "sensor": TransportDelay(0.1, 1),
            "gain": Gain(-1.0, 1),
        },
        {"sensor": "plant", "gain": "sensor", "plant": "gain"},
    )
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([1.0])
    return diagram, context


def MakeNoise():
    noise = RandomSource(RandomDistribution.kGaussian, 1, 0.1)
    return Wired({"noise": noise, "plant": Integrator(1)}, {"plant": "noise"})


def Last(recording):
    return recording["plant.y0"][-1, 0]


METRICS = {"last": Last}


def Exact(delay, k, time=2.0):
    """The method of steps; nothing has been sent before the start."""
    if delay == 0:
        return math.exp(k * time)
    num = math.floor(time / delay)
    powers = [(k * (time - j * delay)) ** j / math.factorial(j) for j in range(num + 1)]
    return sum(powers)


def SweepHere(**more):
    diagram, context = MakeLoop()
    return Sweep(diagram, GRID, metrics=METRICS, duration=2.0, context=context, **more)


def test_values_are_those_of_the_method_of_steps():
    """Also with a delay of 0, which needs another program."""
    result = SweepHere()
    expected = [[Exact(delay, k) for k in GRID["gain.k"]] for delay in DELAYS]
    assert_allclose(result.Values("last"), expected, rtol=1e-8, atol=1e-12)
    assert [row["gain.k"] for row in result.Table()[:2]] == [-1.0, -2.0]


class Elsewhere(Executor):
    """An executor that pickles its calls, as one of other processes does."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        fn, args = pickle.loads(pickle.dumps((fn, args)))
        future.set_result(fn(*args))
        return future


def Files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_threads_and_other_processes_and_a_resumed_sweep_write_the_same(tmp_path):
    result = SweepHere(out=tmp_path / "here", jobs=2)
    expected = Files(tmp_path / "here")
    with ThreadPoolExecutor(2) as threads:
        SweepHere(out=tmp_path / "threads", executor=threads)
    assert Files(tmp_path / "threads") == expected
    options = {"metrics": METRICS, "duration": 2.0, "out": tmp_path / "elsewhere"}
    Sweep(MakeLoop, GRID, executor=Elsewhere(), **options)
    assert Files(tmp_path / "elsewhere") == expected
    runs = tmp_path / "elsewhere" / "runs.jsonl"
    runs.write_text("".join(runs.read_text().splitlines(keepends=True)[:3]))
    again = Sweep(MakeLoop, GRID, resume=True, **options)
    assert Files(tmp_path / "elsewhere") == expected
    assert again.records == result.records
    with pytest.raises(ScenarioError, match=r"other parameters \(duration\)"):
        Sweep(MakeLoop, GRID, resume=True, **{**options, "duration": 1.0})


def test_threads_share_one_program(monkeypatch):
    """Of runs that need no other one."""
    made = []
    init = CompiledSystem.__init__

    def Init(self, *arguments, **options):
        made.append(threading.current_thread())
        init(self, *arguments, **options)

    monkeypatch.setattr(CompiledSystem, "__init__", Init)
    SweepHere(jobs=4)
    assert made == [threading.main_thread()]


def test_samples_of_several_numbers_have_a_run_each():
    samples = [
        {"plant.x0(0)": 2.0, "sensor.delay": np.float64(0.5)},
        {"plant.x0(0)": 3.0, "sensor.delay": 0.2},
    ]
    diagram, context = MakeLoop()
    result = Sweep(diagram, samples, metrics=METRICS, duration=2.0, context=context)
    expected = [2 * Exact(0.5, -1.0), 3 * Exact(0.2, -1.0)]
    assert_allclose(result.Values("last"), expected, rtol=1e-8)
    assert result.axes == {"run": [0, 1]}


def test_seeds_draw_what_drake_draws_and_keep_the_rest_of_the_context():
    diagram = MakeNoise()
    plant = diagram.GetSubsystemByName("plant")
    start = diagram.CreateDefaultContext()
    plant.GetMyMutableContextFromRoot(start).SetContinuousState([0.3])
    seeds = [3, 4]
    options = {"metrics": METRICS, "duration": 0.95, "context": start}
    result = Sweep(diagram, {"seed": seeds}, **options)
    for seed, value in zip(seeds, result.Values("last"), strict=True):
        context = diagram.CreateDefaultContext()
        diagram.SetRandomContext(context, RandomGenerator(seed))
        plant.GetMyMutableContextFromRoot(context).SetContinuousState([0.3])
        simulator = Simulator(diagram, context)
        simulator.AdvanceTo(0.95)
        own = plant.GetMyContextFromRoot(context)
        exact = plant.get_output_port().Eval(own)[0]
        assert value == pytest.approx(exact, abs=1e-7)
    assert {record["solver"]["engine"] for record in result.records} == {"compiled"}


def test_a_metric_that_is_not_finite_is_none_and_a_failure_has_its_reason():
    diagram, context = MakeLoop()
    metrics = {"endless": lambda run: np.inf, **METRICS}
    options = {"duration": 2.0, "context": context}
    grid = {"gain.k": [-1.0]}
    (record,) = Sweep(diagram, grid, metrics=metrics, **options).records
    assert record["metrics"] == {"endless": None, "last": record["metrics"]["last"]}
    wrong = {"text": lambda run: "large"}
    (record,) = Sweep(diagram, grid, metrics=wrong, **options).records
    assert record["status"] == "failed" and "metrics.text = 'large'" in record["reason"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid": {"sensor.dela": [0.1]}}, r"did you mean 'sensor\.delay'"),
        ({"grid": {"sensor.delay": [-0.1]}}, r"sensor\.delay = -0\.1: must be"),
        ({"grid": {"seed": [1, 2]}}, r"grid\.seed = .*nothing in the System is random"),
        ({"grid": [{"gain.k": 1.0}, {"sensor.delay": 1.0}]}, r"grid\.1 = "),
        ({"metrics": None}, "metrics = null: must be"),
        ({"metrics": {}}, "metrics = .*functions of a Recording"),
        ({"duration": None}, "duration = null: must be"),
        ({"overrides": ["a=1"]}, "overrides = 'given': must be left out"),
        ({"executor": Elsewhere()}, "executor = 'Elsewhere': must be a ThreadPool"),
        ({"scenario": MakeLoop}, "context = 'given': must be left out"),
    ],
)
def test_refused(change, message):
    diagram, context = MakeLoop()
    options = {
        "scenario": diagram,
        "grid": {"sensor.delay": [0.1]},
        "metrics": METRICS,
        "duration": 2.0,
        "context": context,
    }
    with pytest.raises(ScenarioError, match=message):
        Sweep(**{**options, **change})


@pytest.mark.slow
def test_dask_has_the_values_of_this_process():
    """A function defined here is sent as it is."""
    distributed = pytest.importorskip("distributed")
    metrics = {"last": lambda recording: Last(recording)}
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None}
    with (
        distributed.LocalCluster(**options) as cluster,
        distributed.Client(cluster) as client,
    ):
        executor = client.get_executor(pure=False)
        found = Sweep(MakeLoop, GRID, metrics=metrics, duration=2.0, executor=executor)
    assert found.records == SweepHere().records
