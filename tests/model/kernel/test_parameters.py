"""A number of a Context has the range that the constructor of its block checks."""

import functools
import re

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import Adder, Gain, Integrator, Sine
from wired import Wired

from teleop_drake import Compile, MakePage, simulate
from teleop_drake.loops import LinearizePorts
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.engine import parameters
from teleop_drake.loops.engine.parameters import CheckNumbers, SetNumbers
from teleop_drake.loops.kernel import Kernel
from teleop_drake.model.run.simulate import MakeDiagram
from teleop_drake.model.scenario import LoadScenario, ScenarioError


def loop():
    """Returns x' = u - x(t - 0.3)."""
    return Wired(
        {
            "x": Integrator(1),
            "sensor": TransportDelay(0.3, 1),
            "gain": Gain(-1.0, 1),
            "adder": Adder(2, 1),
        },
        {"sensor": "x", "gain": "sensor", "adder.u0": "gain", "x": "adder"},
        {"x": "x"},
        inputs={"u": "adder.u1"},
    )


def context_with_delay(diagram, delay):
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, [1.0])
    own = diagram.GetSubsystemByName("sensor").GetMyContextFromRoot(context)
    own.get_mutable_numeric_parameter(0).SetFromVector([delay])
    return context


def in_drake(diagram, delay):
    simulate(
        diagram,
        context=context_with_delay(diagram, delay),
        duration=0.5,
        engine="drake",
    )


def compiled(diagram, delay):
    context = context_with_delay(diagram, delay)
    Compile(diagram, context=context, duration=0.5)


def of_a_kept_program(diagram, delay):
    context = context_with_delay(diagram, 0.3)
    program = Compile(diagram, context=context, duration=0.5)
    program.Run(**{"sensor.delay": delay})


def all_delays_of_a_kept_program(diagram, delay):
    context = context_with_delay(diagram, 0.3)
    Compile(diagram, context=context, duration=0.5).Run(delay=delay)


def in_the_plain_simulator(diagram, delay):
    Simulator(diagram, context_with_delay(diagram, delay)).AdvanceTo(0.5)


def in_a_page(diagram, delay):
    MakePage(diagram, context=context_with_delay(diagram, delay), duration=0.5)


def linearised(diagram, delay):
    context = context_with_delay(diagram, delay)
    LinearizePorts(
        diagram, context, diagram.get_input_port(), diagram.get_output_port()
    )


RUNS = [
    *(in_drake, compiled, of_a_kept_program, all_delays_of_a_kept_program),
    *(in_the_plain_simulator, in_a_page, linearised),
]


@pytest.mark.parametrize("run", RUNS)
@pytest.mark.parametrize("delay", [-0.2, np.inf, np.nan])
def test_a_delay_that_the_constructor_refuses_is_refused_in_every_run(run, delay):
    with pytest.raises(ScenarioError, match=r"delay = -0\.2: must be .* >= 0"):
        TransportDelay(-0.2, 1)
    with pytest.raises(
        ScenarioError, match=r"^(sensor\.)?delay = .*: must be .*finite"
    ):
        run(loop(), delay)


@pytest.mark.parametrize("value", ["long", {"s": 1.0}, [[0.1], [0.1, 0.2]]])
def test_what_is_no_number_is_refused_by_name(value):
    with pytest.raises(ScenarioError, match=r"^sensor\.delay = .*: must be a number"):
        of_a_kept_program(loop(), value)


def test_a_delay_of_0_in_a_context_passes_the_signal():
    diagram = loop()
    context = context_with_delay(diagram, 0.0)
    recording = simulate(diagram, context=context, duration=1.0)
    assert recording["x"][-1, 0] == pytest.approx(1 - np.exp(-1), abs=1e-6)
    with pytest.raises(
        ScenarioError, match=r"^sensor\.delay = 0\.0: must be above 0 s"
    ):
        simulate(diagram, context=context, duration=1.0, engine="drake")


class Own(LeafSystem):
    """y = 2 u, with a kernel, so that a run is compared with Drake."""

    def __init__(self):
        LeafSystem.__init__(self)
        self._u = self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("y", 1, self._Calc)

    def _Calc(self, context, output):
        output.SetFromVector(2 * self._u.Eval(context))

    def Kernel(self):
        return Kernel(outputs={"y": (twice, "u")})


def twice(u):
    return 2 * u


@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_a_delay_in_a_context_beside_an_own_block(delay):
    diagram = Wired(
        {
            "source": Sine(1.0, 2.0, 0.0, 1),
            "late": TransportDelay(0.1, 1),
            "own": Own(),
        },
        {"late": "source.y0", "own": "late"},
        {"y": "own"},
    )
    context = diagram.CreateDefaultContext()
    SetNumbers(diagram, context, {"late.delay": delay})
    recording = simulate(diagram, context=context, duration=1.0)
    assert recording.solver.engine == "compiled"
    expected = 2 * np.sin(2 * (1.0 - delay))
    assert recording["y"][-1, 0] == pytest.approx(expected, abs=1e-9)


WALL = {"kind": "friction_wall", "start": 0.01, "stiffness": 60.0, "damping": 0.1}
SOLID = {
    **{"kind": "standard_linear_solid", "start": 0.01},
    **{"stiffness": 9.0, "branch_stiffness": 9.0},
}
MAKES: dict[str, dict[str, object]] = {
    "one_dof": {},
    "friction_wall": {"environment": WALL},
    "standard_linear_solid": {"environment": SOLID},
    "human": {"surgeon.kind": "human"},
    "move_and_wait": {"surgeon.kind": "move_and_wait"},
}

# What makes the block. For each number: its key in the scenario, a value that is
# refused, one that is barely allowed, and its name in the Context; `*` is the kind.
RANGES = {
    "one_dof": [
        ("forward_channel.delay", -0.1, 0.0, "forward_channel.delay"),
        ("robot.mass", -0.1, 0.1, "robot/plant.carriage.mass"),
        ("environment.layers.bone.stiffness", -1.0, 0.0, "environment.stiffness(bone)"),
    ],
    "adaptive_backstepping": [
        ("controller.G1", 0.0, 0.1, "controller/*.G1"),
        ("controller.G2", -1.0, 0.1, "controller/*.G2"),
        ("controller.Lambda", -1.0, 0.1, "controller/*.Lambda"),
        ("controller.P", 0.0, 0.1, "controller/*.P"),
        ("controller.beta1", -1e-09, 0.0, "controller/*.beta1"),
        ("controller.leakage", -1e-09, 0.0, "controller/*.nu1"),
        ("controller.supervision", 1.1, 1.0, "controller/*.Upsilon"),
        ("controller.minimum_psi", 0.0, 1e-09, "controller/*.Psi_min"),
        ("controller.initial_psi", 0.1, 0.11, "controller/*.Psi0"),
    ],
    "robust_backstepping": [
        ("controller.robust.acceleration_bound", -1.0, 0.0, "controller/*.rho1"),
        ("controller.robust.velocity_width", 0.0, 1e-09, "controller/*.eps1"),
    ],
    "damped_force": [
        ("controller.*.damping", -1.0, 0.0, "controller/*.damping"),
    ],
    "wave_variables": [
        ("controller.*.forward_scaling", 1.1, 1.0, "controller.scaling"),
        ("controller.*.impedance", 0.0, 0.1, "controller.impedance"),
    ],
    "proportional_damping": [
        ("controller.*.stiffness", -1.0, 0.0, "controller.stiffness"),
        ("controller.*.master_mass", 0.0, 0.1, "master/proportional_master.mass"),
    ],
    "four_channel": [
        ("controller.*.master_mass", 0.0, 0.1, "master/four_channel_master.mass"),
        ("controller.*.C_s.stiffness", -1.0, 0.0, "controller.local_stiffness"),
        ("controller.*.C_s.damping", -1.0, 0.0, "controller.local_damping"),
    ],
    "time_domain_passivity": [
        ("controller.*.maximum_damping", 0.0, 1.0, "controller.maximum_damping"),
        ("controller.*.local_damping", -1.0, 0.0, "controller.local_damping"),
    ],
    "friction_wall": [
        ("environment.stiffness", 0.0, 1.0, "environment.normal_law(0)"),
        ("environment.exponent", 0.9, 1.0, "environment.normal_law(1)"),
        ("environment.damping", -1.0, 0.0, "environment.normal_law(2)"),
        ("environment.friction", -1.0, 0.0, "environment.friction_law(0)"),
        ("environment.creep_speed", 0.0, 1e-05, "environment.friction_law(1)"),
    ],
    "standard_linear_solid": [
        ("environment.branch_stiffness", 0.0, 0.1, "environment.solid(1)"),
        ("environment.relaxation_time", 0.0, 0.1, "environment.solid(2)"),
    ],
    "human": [
        ("surgeon.crossover_frequency", 0.0, 0.1, "master/surgeon/hand.crossover"),
        ("surgeon.arm_mass", 0.0, 0.1, "master/surgeon/hand.mass"),
        ("surgeon.arm_stiffness", -1.0, 0.0, "master/surgeon/hand.stiffness"),
        ("surgeon.reaction_delay", -0.1, 0.0, "master/surgeon/reaction.delay"),
    ],
    "move_and_wait": [
        ("surgeon.share", 1.1, 1.0, "master/surgeon.share"),
        ("surgeon.reaction_time", 0.0, 0.1, "master/surgeon.reaction_time"),
    ],
}
CASES = [(kind, *case) for kind, cases in RANGES.items() for case in cases]


def Changes(kind):
    return {"duration": 0.1, **MAKES.get(kind, {"controller.kind": kind})}


@functools.cache
def DiagramOf(kind):
    return MakeDiagram(LoadScenario("one_dof", Changes(kind)))


def write(diagram, context, name, value):
    """Writes a number into a Context without a check."""
    whole, _, inside = name.removesuffix(")").partition("(")
    number = parameters._NumbersIn(diagram, context)[whole]
    array = number.value
    array[number.places[inside] if inside else ...] = value
    number.write(array)


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("kind", "key", "bad", "good", "name"), CASES, ids=[x[1] for x in CASES]
)
def test_a_number_has_one_range_in_a_config_and_in_a_context(
    kind, key, bad, good, name
):
    changes = Changes(kind)
    key = key.replace("*", kind)
    name = name.replace("*", kind)
    diagram = DiagramOf(kind)
    for value in (good, bad):
        context = diagram.CreateDefaultContext()
        # Drake takes the value; a run refuses it.
        write(diagram, context, name, value)
        if value == good:
            LoadScenario("one_dof", {**changes, key: value})
            SetNumbers(diagram, context, {name: value})
            CheckNumbers(diagram, context)
            continue
        with pytest.raises(ScenarioError):
            MakeDiagram(LoadScenario("one_dof", {**changes, key: value}))
        whole = re.escape(name.partition("(")[0])
        with pytest.raises(ScenarioError, match=f"^{whole}"):
            SetNumbers(diagram, context, {name: value})
        with pytest.raises(ScenarioError, match=f"^{whole}"):
            simulate(diagram, context=context, duration=0.1)


def test_one_number_is_a_gain_times_the_identity():
    """As in a scenario; all elements were that number, which is a singular matrix."""
    diagram = MakeDiagram(LoadScenario("two_dof_collision"))
    law = "controller/adaptive_backstepping"
    context = diagram.CreateDefaultContext()
    SetNumbers(diagram, context, {f"{law}.G1": 2.5, "environment.damping": 0.1})
    values = parameters.NamedParameters(diagram, context)
    assert_array_equal(values[f"{law}.G1"].value, 2.5 * np.eye(2))
    assert set(values["environment.damping"].value) == {0.1}


def test_a_wave_line_that_reflects_no_wave_stays_so():
    """The kernel of the matched line has no reflected wave; simulate() ignored it."""
    scenario = LoadScenario("one_dof", {"controller.kind": "wave_variables"})
    diagram = MakeDiagram(scenario)
    context = diagram.CreateDefaultContext()
    with pytest.raises(
        ScenarioError, match=r"damping = .*: must be equal to impedance"
    ):
        SetNumbers(diagram, context, {"master/wave_master.damping": 3.0})
    both = dict.fromkeys(
        ("master/wave_master.damping", "master/wave_master.impedance"), 3.0
    )
    SetNumbers(diagram, diagram.CreateDefaultContext(), both)
