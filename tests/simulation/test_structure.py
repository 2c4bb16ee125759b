"""Runs that take over the program of another one give the same numbers, bit for bit."""

import dataclasses

import numpy as np
import pytest

from teleop_drake.compiler import evaluator
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate, structure
from teleop_drake.tasks import TaskOf

SHORT = {"duration": 0.6, "simulator.accuracy": 1e-6}

CHANNELS = [
    *({"delay": 0.03}, {"delay": 0.17}),
    {"kind": "sampled", "delay": 0.04, "sample_period": 0.01},
    {"kind": "sampled", "delay": 0.05, "sample_period": 0.02},
    {
        **{"kind": "variable", "delay": 0.05},
        "sinusoid": {"amplitude": 0.02, "frequency": 5.0},
    },
    *(
        {
            **{"kind": "network", "delay": 0.02, "sample_period": 0.01, "seed": seed},
            "jitter": {"kind": "uniform", "std": 0.004},
        }
        for seed in (1, 2)
    ),
]


# Between these, a run takes over the program of another one. The tool starts in the
# second layer where that begins behind it.
NUMBERS = {
    "controller.G1": (1.5, 9.0),
    "controller.leakage": (0.0, 0.1),
    "environment.layers.tissue.stiffness": (0.0, 0.4),
    "environment.layers.free.start": (-0.002, 0.002),
    "environment.layers.bone.start": (0.004, 0.02),
}


@pytest.fixture(autouse=True)
def loops(monkeypatch):
    """What is kept, nothing at first."""
    kept = {}
    monkeypatch.setattr(structure, "_loops", kept)
    return kept


@pytest.fixture
def made(monkeypatch):
    """The diagrams that were made."""
    diagrams = []
    task = type(TaskOf(LoadScenario("one_dof")))
    make = task.MakeDiagram

    def MakeDiagram(self, scenario):
        diagrams.append(scenario.name)
        return make(self, scenario)

    monkeypatch.setattr(task, "MakeDiagram", MakeDiagram)
    return diagrams


def Numbers(recording):
    solver = dataclasses.asdict(recording.solver)
    del solver["wall_time_s"], solver["real_time_factor"]
    return [
        recording.time.tobytes(),
        {name: x.tobytes() for name, x in recording.signals.items()},
        *(recording.events, recording.channels, solver, recording.notes),
        *(recording.termination, recording.reason, recording.has_constant_command),
    ]


def Load(task, kind, forward, back, **others):
    channels = {"forward_channel": forward, "return_channel": back}
    return LoadScenario(task, SHORT | {"controller.kind": kind} | channels | others)


@pytest.mark.parametrize(
    ("task", "kind", "num"),
    [
        ("one_dof", "adaptive_backstepping", 6),
        ("two_dof_collision", "direct_force", 3),
        # Their defaults derive from the delays.
        ("one_dof", "smith_predictor", 3),
        ("one_dof", "wave_variables", 3),
    ],
)
def test_runs_with_other_numbers_are_those_of_a_fresh_process(
    task, kind, num, loops, made
):
    rng = np.random.default_rng(num)
    numbers = NUMBERS if task == "one_dof" else {"divergence_speed_ratio": (5.0, 9.0)}
    runs, others = [], {}
    for i in range(num):
        if i % 3:  # Every third run has other channels alone.
            others = {key: rng.uniform(*ends) for key, ends in numbers.items()}
        channels = (CHANNELS[k] for k in rng.integers(len(CHANNELS), size=2))
        runs.append(
            Load(task, kind, *channels, duration=rng.uniform(0.3, 0.9), **others)
        )
    taken_over = [Numbers(simulate(scenario)) for scenario in runs]
    assert len(made) == 1
    for scenario, numbers in zip(runs, taken_over, strict=True):
        loops.clear()
        assert Numbers(simulate(scenario)) == numbers


@pytest.mark.parametrize(
    "other",
    [
        {"forward_channel.delay": 0.0},
        {"controller.network.count": 4},
        {"environment.layers": [{"name": "wall", "start": 0.01, "stiffness": 9.0}]},
        {"environment.layers.bone.stiffness": 0.0},
        {"robot.mass": 1.5},
        {"surgeon.velocity": [0.002]},
        {"actuator.bandwidth": 100.0},
    ],
)
def test_what_differs_otherwise_is_made_anew(other, loops, made):
    kind, delay = "adaptive_backstepping", {"delay": 0.05}
    simulate(Load("one_dof", kind, delay, delay))
    changed = Load("one_dof", kind, delay, delay, **other)
    numbers = Numbers(simulate(changed))
    assert len(made) == 2
    loops.clear()
    assert Numbers(simulate(changed)) == numbers


# Numbers of a scenario, each with values that are likely to be special.
VALUES = {
    "delay": [0.0, 0.02, 0.3],
    "controller.G1": [0.5, 4.0, 9.0],
    "controller.Lambda": [1.0, 2.5],
    "controller.adaptation_rate": [0.0, 0.3, 2.0],
    "controller.leakage": [0.0, 0.01],
    "controller.initial_psi": ["auto", 0.7, 1.0],
    "environment.layers.tissue.stiffness": [0.0, 0.05, 0.4],
    "environment.layers.tissue.damping": [0.0, 0.1],
    "robot.mass": [0.5, 1.0, 3.0],
    "robot.damping": [0.0, 0.2],
    "surgeon.velocity": [[0.004], [0.02]],
    "divergence_speed_ratio": [1.01, 5.0],
    "actuator.bandwidth": [None, 50.0, 80.0],
    "sensor.encoder": [
        {"sample_period": 0.002},
        {"sample_period": 0.01, "resolution": 1e-6},
    ],
}


@pytest.mark.parametrize(
    "task", ["one_dof", pytest.param("two_dof_puncture", marks=pytest.mark.slow)]
)
def test_runs_with_any_other_numbers_are_those_of_a_fresh_process(
    task, loops, monkeypatch
):
    """Programs that several runs share have none of their numbers in them."""
    traced = []
    trace = evaluator.TraceProgram

    def TraceProgram(text, *others):
        traced.append(text)
        return trace(text, *others)

    monkeypatch.setattr(evaluator, "TraceProgram", TraceProgram)
    rng = np.random.default_rng(23)
    runs, changed = [], set()
    for _ in range(9 if task == "one_dof" else 14):
        keys = rng.choice(list(VALUES), size=3, replace=False)
        changes = {key: VALUES[key][rng.integers(len(VALUES[key]))] for key in keys}
        if task != "one_dof":
            changes |= {"surgeon.velocity": rng.uniform(0.02, 0.2, 2).tolist()}
            changes = {k: x for k, x in changes.items() if k[:6] != "robot."}
        runs.append(LoadScenario(task, SHORT | changes))
        changed |= changes.keys()
    evaluator._Compiled.cache_clear()
    shared = [Numbers(simulate(scenario)) for scenario in runs]
    # One for each structure: drives and sensors, and a delay that passes through.
    assert len(traced) == len(set(traced)) < len(runs) / 2
    assert len(changed) > 9
    for scenario, numbers in zip(runs, shared, strict=True):
        evaluator._Compiled.cache_clear()
        loops.clear()
        assert Numbers(simulate(scenario)) == numbers


def test_kinds_of_a_users_own_are_made_anew(made, monkeypatch):
    delay = {"delay": 0.05}
    scenario = Load("one_dof", "own_kinds:BrakedForce", delay, delay, duration=0.1)
    simulate(scenario)
    simulate(scenario)
    assert len(made) == 2


def test_a_run_in_drake_has_its_own_channels(loops):
    """Another solver than machine code has does not take over a loop's diagram."""
    simulate(Load("one_dof", "direct_force", CHANNELS[0], CHANNELS[0]))
    assert loops
    other = Load(
        *("one_dof", "direct_force", CHANNELS[1], CHANNELS[1]),
        **{"simulator.integration_scheme": "runge_kutta3", "duration": 0.2},
    )
    after = simulate(other)
    loops.clear()
    assert after.solver.engine == "drake"
    assert Numbers(after) == Numbers(simulate(other))
