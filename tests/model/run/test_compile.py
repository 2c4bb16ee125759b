"""A compiled scenario gives the same numbers as simulate(), bit for bit."""

import dataclasses
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from foreign.leaves import Assigns
from pydrake.systems.framework import LeafSystem

from teleop_drake import Compile
from teleop_drake.loops.engine import check
from teleop_drake.loops.engine.block_kernels import KernelOf
from teleop_drake.loops.engine.check import KernelDisagrees
from teleop_drake.loops.engine.flatten import Flatten
from teleop_drake.loops.engine.known_programs import ForgetPrograms
from teleop_drake.loops.engine.program import Program
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.kernel import Kernel, KernelBlock
from teleop_drake.loops.run import compiled_run
from teleop_drake.loops.run.compiled_run import CannotCompile
from teleop_drake.model.blocks.architectures import ARCHITECTURE_KINDS, ControlLawConfig
from teleop_drake.model.blocks.architectures.base import LAW_INPUTS
from teleop_drake.model.blocks.architectures.direct_force import DirectForceConfig
from teleop_drake.model.blocks.environments.layered_force_field import (
    LayeredForceField,
    LayersEnvironmentConfig,
)
from teleop_drake.model.run.compiled_scenario import NeedsAnotherProgram
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.scenario.tree import ToTree
from teleop_drake.model.stations import MakeArchitecture
from teleop_drake.model.tasks import TaskOf
from teleop_drake.model.teleoperator import MakeTeleoperator

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

# Where the start of the second layer is < 0, the tool starts inside this layer.
NUMBERS = {
    "controller.G1": (1.5, 9.0),
    "controller.leakage": (0.0, 0.1),
    "environment.layers.tissue.stiffness": (0.0, 0.4),
    "environment.layers.free.start": (-0.002, 0.002),
    "environment.layers.bone.start": (0.004, 0.02),
}


@pytest.fixture
def made(monkeypatch):
    """A list to which the scenario of each diagram that is made is added."""
    diagrams = []
    task = type(TaskOf(LoadScenario("one_dof")))
    make = task.MakeDiagram

    def MakeDiagram(self, scenario):
        diagrams.append(scenario.name)
        return make(self, scenario)

    monkeypatch.setattr(task, "MakeDiagram", MakeDiagram)
    return diagrams


@pytest.fixture
def traced(monkeypatch):
    """A list to which each program that is traced is added."""
    programs = []
    trace = Program.Trace

    def Trace(program):
        programs.append(program)
        return trace(program)

    monkeypatch.setattr(Program, "Trace", Trace)
    ForgetPrograms()
    return programs


def Numbers(recording):
    solver = dataclasses.asdict(recording.solver)
    del solver["wall_time_s"], solver["real_time_factor"]
    return [
        recording.time.tobytes(),
        {name: x.tobytes() for name, x in recording.signals.items()},
        *(recording.events, recording.channels, solver, recording.notes),
        *(recording.termination, recording.reason, recording.has_constant_command),
        [(x.name, x.point_W.tolist(), x.material) for x in recording.surfaces],
    ]


def Load(task, kind, **others):
    return LoadScenario(task, SHORT | {"controller.kind": kind} | others)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("task", "kind", "num"),
    [
        ("one_dof", "adaptive_backstepping", 6),
        ("two_dof_collision", "direct_force", 3),
        # The defaults of these kinds derive from the delays.
        ("one_dof", "smith_predictor", 3),
        ("one_dof", "wave_variables", 3),
    ],
)
def test_runs_with_other_numbers_are_those_of_simulate(task, kind, num, traced):
    rng = np.random.default_rng(num)
    numbers = NUMBERS if task == "one_dof" else {"divergence_speed_ratio": (5.0, 9.0)}
    program = Compile(Load(task, kind, delay=0.05))
    runs = []
    others = {}
    for i in range(num):
        if i % 3:  # In every third run only the channels change.
            others = {key: rng.uniform(*ends) for key, ends in numbers.items()}
        forward, back = (CHANNELS[k] for k in rng.integers(len(CHANNELS), size=2))
        channels = {"forward_channel": forward, "return_channel": back}
        runs.append(channels | others | {"duration": rng.uniform(0.3, 0.9)})
    found = [Numbers(program.Run(**changes)) for changes in runs]
    assert len(traced) == 1
    for changes, numbers in zip(runs, found, strict=True):
        assert Numbers(simulate(Load(task, kind, **changes))) == numbers


# Numbers of the Context, by the kind of controller.
IN_CONTEXT = {
    "adaptive_backstepping": {
        "controller.G1": 3.0,
        "controller.P.0.0": 1.5,
        "controller.leakage": 0.3,
        "surgeon.velocity.0": 0.0012,
        "environment.layers.bone.stiffness": 91.0,
    },
    "direct_force": {"forward_channel": {"kind": "transport", "delay": 0.03}},
    "damped_force": {"controller.damped_force.damping": 3.0},
    "proportional_damping": {"controller.proportional_damping.margin": 3.0},
    "four_channel": {"delay": 0.08, "controller.four_channel.master_mass": 0.6},
    "wave_variables": {"controller.wave_variables.return_scaling": 0.9},
    "smith_predictor": {"delay": 0.08},
    "time_domain_passivity": {"surgeon.contact_force": [0.01]},
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", IN_CONTEXT)
def test_numbers_of_a_context_make_no_diagram(kind, made):
    given = {"controller.P": [[1.0]], "forward_channel.delay": 0.05}
    given["controller.time_domain_passivity.initial_energy"] = 1e-6
    changes = IN_CONTEXT[kind] | {"duration": 0.4}
    found = Compile(Load("one_dof", kind, **given)).Run(**changes)
    assert len(made) == 1
    expected = simulate(Load("one_dof", kind, **given | changes))
    assert Numbers(found) == Numbers(expected)


# Fields from which defaults of architectures derive.
SOURCES = [
    {"controller.Lambda": 0.7},
    {"environment.layers.tissue.damping": 0.3},
    {"environment.layers.tissue.stiffness": 0.2, "surgeon.velocity": [0.0012]},
    {"robot.mass": 0.6},
    {"haptic_device.numerator": [0.3, 1.2]},
    {"return_channel.delay": 0.2},
]


@pytest.mark.mostly_slow
@pytest.mark.parametrize("kind", [kind.kind for kind in ARCHITECTURE_KINDS.kinds])
def test_defaults_follow_the_fields_from_which_they_derive(kind):
    given = {"controller.initial_psi": "auto", "duration": 0.3}
    program = Compile(Load("one_dof", kind, **given))
    for changes in SOURCES:
        expected = simulate(Load("one_dof", kind, **given | changes))
        assert Numbers(program.Run(**changes)) == Numbers(expected), changes


# What stands in the loop, and two changes of numbers of it.
OUTSIDE = {
    "operator": ({}, {"surgeon.velocity": [0.004]}, {"surgeon.contact_force": [0.01]}),
    "human": (
        {"surgeon.kind": "human"},
        {"surgeon.crossover_frequency": 1.4},
        {"surgeon.reaction_delay": 0.1, "environment.layers.bone.stiffness": 90.0},
    ),
    "stop": (
        {"surgeon.stop_time": 0.3},
        {"surgeon.stop_time": 0.5},
        {"surgeon.stop_time": 0.0},
    ),
    "trapezoid": (
        {"surgeon.kind": "trapezoid", "surgeon.rise_time": 0.2},
        {"surgeon.rise_time": 0.4},
        {"surgeon.velocity": [-0.002]},
    ),
    "device": (
        {},
        {"haptic_device.denominator": [1.0, 3.0, 0.0]},
        {"haptic_device.numerator": [0.3, 1.2]},
    ),
    "actuator": (
        {"actuator.bandwidth": 60.0},
        {"actuator.bandwidth": 90.0},
        {"actuator.bandwidth": 90.0, "controller.G1": 3.0},
    ),
    "sensor": (
        {"sensor.encoder": {"sample_period": 0.004}},
        {"sensor.encoder.sample_period": 0.01},
        {"sensor.encoder.resolution": 1e-6},
    ),
    "wall": (
        {"environment": {"kind": "hunt_crossley", "start": 0.001, "stiffness": 60.0}},
        {"environment.stiffness": 90.0, "surgeon.velocity": [0.006]},
        {"environment.start": 0.0005},
    ),
}


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "scene",
    [
        *("operator", "human"),
        *(pytest.param(x, marks=pytest.mark.slow) for x in list(OUTSIDE)[2:]),
    ],
)
def test_other_fields_of_a_block_need_no_other_program(scene, traced):
    given, *runs = OUTSIDE[scene]
    given = {**SHORT, "duration": 0.4, **given}
    kind = "proportional_damping" if scene == "operator" else "adaptive_backstepping"
    given |= {"controller.kind": kind}
    program = Compile(LoadScenario("one_dof", given))
    found = [Numbers(program.Run(**changes)) for changes in runs]
    assert len(traced) == 1
    for changes, numbers in zip(runs, found, strict=True):
        assert Numbers(simulate(LoadScenario("one_dof", given | changes))) == numbers


# Numbers of a scenario, each with values that are likely to be special.
VALUES = {
    "delay": [0.02, 0.3],
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
    "actuator.bandwidth": [50.0, 80.0],
    "sensor.encoder": [
        {"sample_period": 0.002},
        {"sample_period": 0.01, "resolution": 1e-6},
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "task", ["one_dof", pytest.param("two_dof_puncture", marks=pytest.mark.slow)]
)
def test_any_other_numbers_need_no_other_program(task, traced):
    rng = np.random.default_rng(23)
    given = {"actuator.bandwidth": 60.0, "sensor.encoder": {"sample_period": 0.004}}
    program = Compile(LoadScenario(task, SHORT | given))
    runs = []
    changed = set()
    for _ in range(9 if task == "one_dof" else 14):
        keys = rng.choice(list(VALUES), size=3, replace=False)
        changes = {key: VALUES[key][rng.integers(len(VALUES[key]))] for key in keys}
        if task != "one_dof":
            changes |= {"surgeon.velocity": rng.uniform(0.02, 0.2, 2).tolist()}
            changes = {k: x for k, x in changes.items() if k[:6] != "robot."}
        runs.append(changes)
        changed |= changes.keys()
    assert len(changed) > 9
    found = [Numbers(program.Run(**changes)) for changes in runs]
    assert len(traced) == 1
    for changes, numbers in zip(runs, found, strict=True):
        assert Numbers(simulate(LoadScenario(task, SHORT | given | changes))) == numbers


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"delay": 0.0}, "delay = 0.0"),
        ({"duration": 0.5, "return_channel.delay": 0.0}, "return_channel.delay = 0.0"),
        ({"controller.kind": "direct_force"}, "controller.kind = 'direct_force'"),
        ({"controller.network.count": 4}, "controller.network.count = 4"),
        ({"actuator.bandwidth": 100.0}, "actuator.bandwidth = 100.0"),
        (
            {"environment.layers": [{"name": "wall", "start": 0.01, "stiffness": 9.0}]},
            "environment.layers = ",
        ),
    ],
)
def test_what_needs_another_program_is_refused_by_name(changes, named, one_dof):
    with pytest.raises(NeedsAnotherProgram) as error:
        one_dof.Run(**changes)
    (line,) = str(error.value).splitlines()
    assert line.startswith(named)
    assert line.endswith("; Compile() the changed scenario")


@pytest.fixture(scope="module")
def one_dof():
    return Compile(Load("one_dof", "adaptive_backstepping", delay=0.05))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dely": 0.1}, "dely = 0.1: unknown key 'dely', must be one of"),
        ({"delay": -0.1}, "forward_channel.delay = -0.1: must be 0 or a finite"),
        ({"controller.G1": "much"}, "controller.G1 = 'much': must be"),
        ({"simulator.integration_scheme": "runge_kutta3"}, "compiled runs use"),
    ],
)
def test_bad_changes_are_refused_in_one_line(changes, message, one_dof):
    with pytest.raises(ScenarioError) as error:
        one_dof.Run(**changes)
    (line,) = str(error.value).splitlines()
    assert message in line


def test_a_run_leaves_no_trace(one_dof):
    before = Numbers(one_dof.Run())
    one_dof.Run(**{"delay": 0.1, "environment.layers.free.start": -0.002})
    one_dof.scenario.forward_channel.delay = 0.2
    recording = one_dof.Run()
    assert Numbers(recording) == before
    recording.scenario.duration = 0.1
    assert Numbers(one_dof.Run()) == before
    assert one_dof.scenario.duration == 0.6


def test_what_drake_runs_is_not_compiled():
    system = Assigns()
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, [1.0, 2.0])
    with pytest.raises(CannotCompile, match=r"Assigns .*it assigns to self\.integral"):
        Compile(system, context=context, duration=1.0)


@pytest.mark.slow
def test_a_law_without_a_kernel_is_compiled_as_it_stands():
    scenario = Load("one_dof", "own_kinds:BrakedForce", duration=1.0)
    recording = Compile(scenario).Run()
    assert recording.notes == [
        "controller/braked_force: machine code of the Python code as it stands, "
        "compared with Drake."
    ]
    expected = simulate(scenario, engine="drake")
    assert recording["tool_position"][-1] == pytest.approx(
        expected["tool_position"][-1], abs=1e-7
    )


def Delays(k):
    return {"delay": 0.02 + 0.01 * k, "controller.G1": 2.0 + 0.1 * k}


def test_threads_give_the_numbers_of_one_after_the_other(one_dof):
    expected = [Numbers(one_dof.Run(**Delays(k))) for k in range(8)]
    with ThreadPoolExecutor(2) as pool:
        runs = pool.map(lambda k: one_dof.Run(**Delays(k)), range(8))
        assert [Numbers(run) for run in runs] == expected


@pytest.mark.parametrize(
    "kind", [x.kind for x in ARCHITECTURE_KINDS.kinds if not x.derives_from_channels]
)
def test_an_architecture_derives_from_channels_or_tells_so(kind):
    """If a kind does not derive from channels, they do not change its sides."""
    found = []
    for channel in CHANNELS:
        scenario = Load(
            "one_dof", kind, forward_channel=channel, duration=1 + len(found)
        )
        made = MakeArchitecture(scenario)
        sides = [x for x in (made.master_side, made.slave_side) if x is not None]
        parameters = []
        for side in sides:
            contexts = ContextsIn(side, side.CreateDefaultContext())
            for block in Flatten(side):
                context = contexts[block.system]
                state = context.get_continuous_state_vector().CopyToVector()
                kernel = KernelOf(block.system, context)
                parameters += [repr(kernel.parameters), state.tolist()]
        packets = made.initial_forward_packet, made.initial_return_packet
        found.append((parameters, packets))
    assert all(each == found[0] for each in found)


@dataclasses.dataclass(kw_only=True, eq=False)
class Hesitant(DirectForceConfig):
    """Direct force with a gain that decreases with the delay."""

    def MakeControlLaw(self, facts, path):
        return Scaled(1.0 / (1.0 + facts.round_trip))


class Scaled(KernelBlock):
    """F_c = gain F_h, with a second gain in the law that is a global variable."""

    def __init__(self, gain, law=None):
        KernelBlock.__init__(self)
        self.set_name("scaled")
        self._gain = gain
        self._law = law or scaled
        for name in LAW_INPUTS:
            self.DeclareVectorInputPort(name, 1)
        self.DeclareOutputs(control_force=1)

    def Kernel(self):
        return Kernel(
            parameters={"gain": self._gain},
            outputs={"control_force": (self._law, "gain", "haptic_force")},
            unused=LAW_INPUTS[1:],
        )


SECOND_GAIN = [1.0]


def scaled(gain, force):
    return SECOND_GAIN[0] * gain * force


def test_an_own_architecture_derives_from_channels():
    """Its sides are made again even if it inherits from a kind that does not derive."""
    own = f"{__name__}:Hesitant"
    program = Compile(Load("one_dof", own, delay=0.05))
    run = program.Run(delay=0.1)
    assert run.solver.engine == "compiled"
    assert Numbers(run) == Numbers(simulate(Load("one_dof", own, delay=0.1)))


def test_what_a_law_reads_is_read_when_it_is_traced(monkeypatch):
    scenario = Load("one_dof", f"{__name__}:Hesitant", delay=0.05, duration=0.2)
    program = Compile(scenario)
    first = program.Run()
    assert Numbers(simulate(scenario)) == Numbers(first)
    monkeypatch.setitem(globals(), "SECOND_GAIN", [2.0])
    assert Numbers(program.Run()) == Numbers(first)
    second = simulate(scenario)
    assert second.solver.engine == "compiled"
    assert np.abs(second["control_force"]).max() == pytest.approx(
        2 * np.abs(first["control_force"]).max(), rel=0.05
    )


CALLS = []


class Shared:
    """The state that two laws share."""

    gain = 1.0


shared = Shared()


def appending(gain, force):
    CALLS.append(gain)
    return gain * force


def reading_the_clock(gain, force):
    return gain * force + 0.0 * time.time()


def writing(gain, force):
    shared.gain = 1.0 + force[0]
    return gain * force


def reading(position, velocity):
    return shared.gain * velocity


class Reader(KernelBlock):
    """An environment whose force is computed by the law reading()."""

    def __init__(self):
        KernelBlock.__init__(self)
        self.set_name("environment")
        for name in ("tool_position", "tool_velocity"):
            self.DeclareVectorInputPort(name, 1)
        self.DeclareOutputs(environment_force=1)

    def Kernel(self):
        law = (reading, "tool_position", "tool_velocity")
        return Kernel(outputs={"environment_force": law})


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("law", "place"),
    [
        (appending, "appending(), line"),
        (reading_the_clock, "reading_the_clock(), line"),
        (writing, "writing(), line"),
    ],
)
def test_a_law_of_which_the_state_changes_in_a_run_runs_in_drake(law, place):
    scenario = Load("one_dof", "direct_force", duration=0.05)
    teleoperator = MakeTeleoperator(
        scenario, control_law=Scaled(0.5, law), environment=Reader()
    )
    recording = simulate(scenario, teleoperator=teleoperator)
    assert recording.solver.engine == "drake"
    assert any(place in note for note in recording.notes)


class Wrong(LeafSystem):
    """A law whose kernel is wrong above a limit of the force."""

    def __init__(self, limit):
        LeafSystem.__init__(self)
        self.set_name("wrong")
        self._limit = limit
        ports = [self.DeclareVectorInputPort(name, 1) for name in LAW_INPUTS]
        self._force = ports[0]
        self.DeclareVectorOutputPort(
            "control_force", 1, self._Calc, {self._force.ticket()}
        )

    def _Calc(self, context, output):
        output.SetFromVector(np.minimum(self._force.Eval(context), self._limit))

    def Kernel(self):
        outputs = {"control_force": (unlimited, "haptic_force")}
        return Kernel(outputs=outputs, unused=LAW_INPUTS[1:])


def unlimited(force):
    return force + 0.0


@dataclasses.dataclass(kw_only=True, eq=False)
class WrongConfig(ControlLawConfig):
    """The config of Wrong."""

    limit: float = -1.0

    def MakeControlLaw(self, facts, path):
        return Wrong(self.limit)


@pytest.mark.parametrize("limit", [-1.0, 1e-4], ids=["at the start", "on the way"])
def test_a_kernel_that_is_wrong_is_found_in_the_first_run(limit):
    kind = {"controller.parameters": {"limit": limit}}
    program = Compile(Load("one_dof", f"{__name__}:WrongConfig", **kind))
    with pytest.raises(KernelDisagrees, match="wrong: its kernel says control_force"):
        program.Run()


class OwnField(LayeredForceField):
    """A user's own block."""


@dataclasses.dataclass(kw_only=True, eq=False)
class OwnLayers(LayersEnvironmentConfig):
    """The layers of the package, made by a user's own block."""

    def MakeEnvironment(self, start):
        return OwnField(
            layers=self.layers,
            num_axes=np.size(start),
            starts_inside=self._StartsInside(start),
            direction=self.direction,
            axis_point=start,
        )


def test_an_own_block_that_a_change_brings_in_is_compared(monkeypatch, one_dof):
    compared = []

    def CheckVisited(evaluator, diagram, context, visited):
        compared.append(type(diagram.GetSubsystemByName("environment")))

    monkeypatch.setattr(compiled_run, "CheckVisited", CheckVisited)
    one_dof.Run()
    layers = ToTree(one_dof.scenario.environment.layers)
    own = {"kind": f"{__name__}:OwnLayers", "layers": layers}
    one_dof.Run(environment=own)
    assert compared == [OwnField]


def test_blocks_of_the_package_are_not_compared(monkeypatch):
    monkeypatch.setattr(check, "Compare", None)
    assert simulate(Load("one_dof", "direct_force")).solver.engine == "compiled"
