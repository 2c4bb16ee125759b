"""Numbers changed in a Context have the effect of the same numbers in a scenario."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Adder, ConstantVectorSource, Gain, Integrator
from wired import Wired

from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.engine.known_programs import ForgetPrograms
from teleop_drake.loops.engine.parameters import (
    NamedParameters,
    ScalarsIn,
    SetNumbers,
)
from teleop_drake.loops.engine.program import Program
from teleop_drake.loops.run import compiled_run
from teleop_drake.loops.run.compiled_run import CannotCompile
from teleop_drake.model.run.compile import Compile
from teleop_drake.model.run.simulate import MakeDiagram, simulate
from teleop_drake.model.scenario import LoadScenario, ScenarioError
from teleop_drake.model.signals import NamedSignals

# The tool leaves the tissue and reaches the bone within the run.
NEAR = {
    "duration": 1.2,
    "environment.layers.free.start": 1e-4,
    "environment.layers.bone.start": 2e-4,
    "environment.layers.bone.reference": 2e-4,
}

LAW = "controller/adaptive_backstepping"

# A key of a scenario, a value, and the parameters of blocks that it sets.
NUMBERS = [
    ("surgeon.velocity", [0.0012], ["master/surgeon.velocity"]),
    ("surgeon.contact_force", [0.007], ["master/surgeon.contact_force"]),
    ("forward_channel.delay", 0.07, ["forward_channel.delay"]),
    ("return_channel.delay", 0.13, ["return_channel.delay"]),
    ("controller.Lambda", 0.8, [f"{LAW}.Lambda"]),
    ("controller.G1", 3.0, [f"{LAW}.G1"]),
    ("controller.G2", 15.0, [f"{LAW}.G2"]),
    ("controller.P", 1.5, [f"{LAW}.P"]),
    ("controller.beta1", 0.3, [f"{LAW}.beta1"]),
    ("controller.beta2", 0.4, [f"{LAW}.beta2"]),
    ("controller.beta3", 0.5, [f"{LAW}.beta3"]),
    ("controller.leakage", 0.3, [f"{LAW}.nu1", f"{LAW}.nu3"]),
    ("robot.mass", 0.7, ["robot/plant.carriage.mass"]),
    ("robot.damping", 0.4, ["robot/plant.rail.damping"]),
    ("environment.layers.tissue.damping", 0.9, ["environment.damping(tissue)"]),
    ("environment.layers.bone.stiffness", 90.0, ["environment.stiffness(bone)"]),
    ("environment.layers.bone.reference", 1.5e-4, ["environment.reference(bone)"]),
]


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    "engine", ["compiled", pytest.param("drake", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    ("key", "value", "names"), NUMBERS, ids=[key for key, _, _ in NUMBERS]
)
def test_a_number_in_a_context_is_that_number_in_a_scenario(key, value, names, engine):
    scenario = LoadScenario("one_dof", NEAR)
    diagram = MakeDiagram(scenario)
    context = diagram.CreateDefaultContext()
    for name in names:
        SetNumbers(diagram, context, {name: value})
    changed = simulate(
        diagram,
        context=context,
        duration=scenario.duration,
        simulator=scenario.simulator,
        engine=engine,
        signals=NamedSignals(diagram.GetSystems()),
    )
    expected = simulate(LoadScenario("one_dof", NEAR | {key: value}), engine=engine)
    assert changed.solver.engine == expected.solver.engine == engine
    assert set(changed) == set(expected)
    for name in expected:
        assert_allclose(
            changed[name][-1], expected[name][-1], rtol=1e-9, atol=1e-12, err_msg=name
        )
    # The number has an effect.
    unchanged = simulate(scenario, engine="compiled")
    assert any(
        np.abs(changed[name][-1] - unchanged[name][-1]).max(initial=0.0) > 1e-7
        for name in expected
    )


def late_growth():
    """Returns x' = x(t - T) with the history 1; T is 0.5 s in the default Context."""
    delay = TransportDelay(delay=0.5, size=1, initial_value=[1.0])
    return Wired(
        {"plant": Integrator(1), "late": delay},
        {"late": "plant", "plant": "late"},
        {"x": "plant"},
    )


def exact(start, delay, time):
    """Returns x by the method of steps, up to two delays after the start."""
    s = np.maximum(time - delay, 0)
    return start + np.minimum(time, delay) + start * s + s**2 / 2


def test_a_compiled_system_runs_with_the_numbers_of_its_context_and_with_others():
    diagram = late_growth()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([2.0])
    program = Compile(diagram, context=context, duration=0.8)
    for numbers, delay in (({}, 0.5), ({"late.delay": 0.7}, 0.7), ({}, 0.5)):
        recording = program.Run(**numbers)
        assert recording.solver.engine == "compiled"
        expected = exact(2.0, delay, recording.time)
        assert_allclose(recording["x"][:, 0], expected, atol=1e-9)
    assert program.Run(duration=0.3).time[-1] == 0.3
    assert context.get_time() == 0.0


def test_what_runs_of_a_compiled_system_share_is_made_once(monkeypatch):
    """The problem of a run depends on its end, and is kept for the last end only."""
    program = Compile(late_growth(), duration=0.8)
    ends = []

    def MakeProblem(shared, start, end, past):
        ends.append(end)
        return made(shared, start, end, past)

    made = compiled_run.MakeProblem
    monkeypatch.setattr(compiled_run, "MakeProblem", MakeProblem)
    durations = (0.8, 0.8, 0.3, 0.8)
    recordings = [program.Run(duration=duration) for duration in durations]
    assert ends == [0.8, 0.3, 0.8]
    assert [recording.time[-1] for recording in recordings] == list(durations)
    first, *_, last = (recording["x"] for recording in recordings)
    assert_array_equal(first, last)


def test_a_compiled_system_refuses_unknown_names():
    program = Compile(late_growth(), duration=0.8)
    with pytest.raises(ScenarioError, match=r"^parameter = 'late.size': must be"):
        program.Run(**{"late.size": 2})
    with pytest.raises(ScenarioError, match=r"^duration = null: must be"):
        Compile(late_growth())
    with pytest.raises(ScenarioError, match=r"^duration = 'given': must be left"):
        Compile("one_dof", duration=1.0)


@pytest.mark.parametrize("name", ["carriage.mass", "rail.damping"])
def test_a_negative_number_of_a_plant_does_not_end_the_process(name):
    diagram = MakeDiagram(LoadScenario("one_dof"))
    context = diagram.CreateDefaultContext()
    with pytest.raises(ScenarioError, match=r"= -1\.0: must be a finite number >= 0"):
        SetNumbers(diagram, context, {f"robot/plant.{name}": -1.0})


class TwoGroups(LeafSystem):
    """A system with two groups of discrete states."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareDiscreteState([1.0, 2.0])
        self.DeclareDiscreteState([3.0])


def test_states_of_several_groups_are_those_of_the_first():
    system = TwoGroups()
    states = ScalarsIn(system, system.CreateDefaultContext())
    values = {name: state.value for name, state in states.items()}
    assert values == {"x0(0)": 1.0, "x1(0)": 2.0}


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


def same_rows(one, other):
    assert one.solver.engine == other.solver.engine == "compiled"
    assert one.time.tobytes() == other.time.tobytes()
    assert list(one) == list(other)
    for name in one:
        assert one[name].tobytes() == other[name].tobytes(), name


# Numbers that share a place of the program with equal numbers of other blocks.
SHARED = {
    "one_dof": ["robot/plant.carriage.mass", "robot/plant.rail.damping"],
    "four_channel": [
        "controller.local_damping",
        "master/four_channel_master.local_stiffness",
        "robot/plant.tool.mass",
    ],
    "two_dof_collision": [],
}


def names_in_context(diagram):
    """Returns the parameters that a Context has; it has no constants of Drake's."""
    scalars = ScalarsIn(diagram, diagram.CreateDefaultContext())
    constants = {name.partition("(")[0] for name, x in scalars.items() if x.is_constant}
    return [name for name in NamedParameters(diagram) if name not in constants]


@pytest.mark.mostly_slow
@pytest.mark.parametrize(
    ("name", "takes_all"),
    [
        *(("one_dof", False), ("four_channel", False)),
        *(pytest.param(name, True, marks=pytest.mark.slow) for name in SHARED),
    ],
)
def test_any_number_of_a_context_runs_in_a_kept_program(name, takes_all):
    scenario = LoadScenario(name if name != "four_channel" else "one_dof")
    if name == "four_channel":
        scenario.controller.kind = name
    diagram = MakeDiagram(scenario)
    options = {"duration": 0.05, "simulator": scenario.simulator}
    program = Compile(diagram, **options)
    values = NamedParameters(diagram)
    for key in names_in_context(diagram) if takes_all else SHARED[name]:
        value = values[key].value
        number = np.multiply(value, 0.97) + (0.0 if np.any(value) else 0.01)
        context = diagram.CreateDefaultContext()
        SetNumbers(diagram, context, {key: number})
        expected = simulate(diagram, context=context, **options)
        same_rows(program.Run(**{key: number}), expected)
    # No number of an earlier run is left.
    same_rows(program.Run(), simulate(diagram, **options))


def motor():
    """Returns a cart of 2 kg on a rail that a motor pushes with 3 N."""
    plant = MultibodyPlant(0.0)
    inertia = SpatialInertia.SolidSphereWithMass(2.0, 0.1)
    cart = plant.AddRigidBody("cart", inertia)
    rail = PrismaticJoint("rail", plant.world_frame(), cart.body_frame(), [1, 0, 0])
    plant.AddJointActuator("motor", plant.AddJoint(rail))
    plant.Finalize()
    builder = DiagramBuilder()
    builder.AddNamedSystem("plant", plant)
    push = builder.AddNamedSystem("push", ConstantVectorSource([3.0]))
    builder.Connect(push.get_output_port(), plant.get_actuation_input_port())
    builder.ExportOutput(plant.get_state_output_port(), "state")
    return builder.Build()


def test_the_gears_of_a_motor_are_numbers():
    """The motor has the apparent mass ratio^2 inertia at the cart."""
    program = Compile(motor(), duration=1.0)
    for ratio, inertia in ((1.0, 0.0), (3.0, 0.5), (-3.0, 0.5)):
        numbers = {
            "plant.motor.gear_ratio": ratio,
            "plant.motor.rotor_inertia": inertia,
        }
        position, speed = program.Run(**numbers)["state"][-1]
        acceleration = 3.0 / (2.0 + ratio**2 * inertia)
        assert position == pytest.approx(acceleration / 2)
        assert speed == pytest.approx(acceleration)
    with pytest.raises(ScenarioError, match=r"rotor_inertia = -1\.0: must be .* >= 0"):
        program.Run(**{"plant.motor.rotor_inertia": -1.0})


def test_numbers_that_become_equal_need_no_other_program(traced):
    scenario = LoadScenario("one_dof", {"controller.kind": "four_channel"})
    diagram = MakeDiagram(scenario)
    context = diagram.CreateDefaultContext()
    SetNumbers(diagram, context, {"controller.local_damping": 3.0})
    program = Compile(diagram, context=context, duration=0.05)
    # The damping of the controller is 3, too.
    numbers = {"master/four_channel_master.local_damping": 3.0}
    recording = program.Run(**numbers)
    assert len(traced) == 1
    SetNumbers(diagram, context, numbers)
    same_rows(recording, simulate(diagram, context=context, duration=0.05))


def test_a_program_for_other_numbers_is_kept(traced):
    diagram = MakeDiagram(LoadScenario("one_dof"))
    program = Compile(diagram, duration=0.05)
    program.Run(**{"robot/plant.carriage.mass": 0.6})
    assert len(traced) == 1
    # Without direct feedthrough the device has another program.
    for feedthrough in (0.1, 0.2, 0.3):
        program.Run(**{"master/haptic_device/transfer_function.D": feedthrough})
    assert len(traced) == 2


def relay_loop():
    """Returns x = 2 - x(t - T), which has no program at T = 0."""
    return Wired(
        {
            "one": ConstantVectorSource([2.0]),
            "late": TransportDelay(0.5, 1),
            "difference": Adder(2, 1),
            "minus": Gain(-1.0, 1),
        },
        {
            "difference.u0": "one",
            "minus": "late",
            "difference.u1": "minus",
            "late": "difference",
        },
        {"x": "difference"},
    )


def test_a_number_without_a_program_is_refused_in_plain_words():
    program = Compile(relay_loop(), duration=1.2)
    assert program.Run(**{"late.delay": 0.4})["x"][-1] == 2.0
    with pytest.raises(CannotCompile) as error:
        program.Run(**{"late.delay": 0.0})
    (line,) = str(error.value).splitlines()
    assert line.startswith("late.delay = 0.0: ")
    assert "depends on itself" in line
    assert "simulate(system, context=...)" in line


def test_a_delay_of_0_runs_in_a_kept_program_of_a_system():
    """x' = x(t - T) is exp(t) without a delay."""
    diagram = late_growth()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([2.0])
    program = Compile(diagram, context=context, duration=0.8)
    for delay in (0.0, 0.7, 0.0):
        x = program.Run(**{"late.delay": delay})["x"][-1, 0]
        expected = exact(2.0, delay, 0.8) if delay else 2 * np.exp(0.8)
        assert x == pytest.approx(expected, rel=1e-6)
