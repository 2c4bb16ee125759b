"""Numbers that Drake keeps as constants have the effect of a system made with them."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import (
    AffineSystem,
    ConstantVectorSource,
    Gain,
    LinearSystem,
    MatrixGain,
    Multiplexer,
    Saturation,
    Sine,
)
from wired import InSeries, Wired

from teleop_drake import Compile, MakePage, simulate
from teleop_drake.blocks import LayerConfig, LayeredForceField
from teleop_drake.loops import NamedParameters
from teleop_drake.loops.engine.constants import ConstantsOf
from teleop_drake.loops.engine.parameters import SetNumbers
from teleop_drake.loops.kernel import Kernel
from teleop_drake.model.scenario import ScenarioError

SHORT = {"duration": 1.5}


def driven(*systems, names):
    """Returns systems one after another, the first of which has sines as inputs."""
    width = systems[0].get_input_port(0).size()
    sines = {"sine0": Sine(2.0, 1.3, 0.4, 1), "sine1": Sine(1.5, 0.7, 2.0, 1)}
    parts = {"mux": Multiplexer([1] * width)} | dict(list(sines.items())[:width])
    parts |= zip(names, systems, strict=True)
    waves = {f"mux.u{i}": f"sine{i}.y0" for i in range(width)}
    return Wired(parts, waves | InSeries("mux", *names))


def alone(system):
    return driven(system, names=["x"])


def controlled(**gains):
    """Returns x'' = u under a PID controller that follows a constant."""
    plant = LinearSystem([[0, 1], [0, 0]], [[0], [1]], np.eye(2), np.zeros((2, 1)))
    return Wired(
        {
            "plant": plant,
            "x": PidController(**gains),
            "aim": ConstantVectorSource([1.0, 0.0]),
        },
        {"x.estimated_state": "plant", "x.desired_state": "aim", "plant": "x"},
    )


def pid(kp=(4.0,), ki=(0.5,), kd=(3.0,)):
    return controlled(kp=kp, ki=ki, kd=kd)


def linear(A=((-1.0, 0.3), (0.0, -2.0)), B=((1.0,), (0.7,)), D=((0.0,),), period=0.0):
    return alone(LinearSystem(A, B, [[1.0, 0.5]], D, period))


def affine(f0=(0.3,), y0=(0.1,), period=0.0):
    return alone(AffineSystem([[-1.0]], [[1.0]], f0, [[2.0]], [[0.0]], y0, period))


# A function that makes a Diagram, and the constants of its system `x` that differ.
CASES = [
    (lambda k=(2.0, 3.0): alone(Gain(k)), {"k": (0.5, 3.0)}),
    (lambda k=(2.0, 3.0): alone(Gain(k)), {"k": (1.0, 0.0)}),
    (
        lambda min_value=(-1.0,), max_value=(1.2,): alone(
            Saturation(min_value, max_value)
        ),
        {"max_value": (0.4,)},
    ),
    (lambda D=((1.0, 2.0),): alone(MatrixGain(D)), {"D": ((0.3, -1.0),)}),
    (linear, {"A": ((-1.0, 0.9), (0.2, -3.0))}),
    (linear, {"B": ((0.0,), (1.0,)), "D": ((0.4,),)}),
    (lambda **x: linear(period=0.1, **x), {"A": ((-0.5, 0.9), (0.2, 0.1))}),
    (affine, {"f0": (0.8,), "y0": (-1.0,)}),
    (lambda **x: affine(period=0.1, **x), {"f0": (0.8,)}),
    (pid, {"kp": (9.0,)}),
    (pid, {"ki": (0.0,), "kd": (1.0,)}),
]


def same_rows(one, other):
    assert one.solver.engine == other.solver.engine == "compiled"
    assert one.time.tobytes() == other.time.tobytes()
    for name in one:
        assert_array_equal(one[name], other[name], err_msg=name)


@pytest.mark.parametrize(("make", "constants"), CASES)
def test_a_constant_of_a_kept_program_is_that_of_a_new_system(make, constants):
    program = Compile(make(), **SHORT)
    before = program.Run()
    changed = program.Run(**{f"x.{name}": x for name, x in constants.items()})
    same_rows(changed, simulate(make(**constants), **SHORT))
    assert any((changed[name][-1] != before[name][-1]).any() for name in before)
    same_rows(program.Run(), before)


def test_constants_are_among_the_named_parameters():
    diagram = driven(Gain([2.0]), Saturation([-1.0], [3.0]), names=["gain", "limit"])
    values = {name: x.value for name, x in NamedParameters(diagram).items()}
    assert values == {
        "gain.k": [2.0],
        "limit.min_value": [-1.0],
        "limit.max_value": [3.0],
    }
    source = NamedParameters(ConstantVectorSource([1.0, 2.0]))["value"].value
    assert_array_equal(source, [1.0, 2.0])


def test_a_controller_of_selected_states_has_no_constants():
    """pydrake does not tell which states it selects."""
    selecting = PidController(np.eye(2, 4), [1.0], [1.0], [1.0])
    assert ConstantsOf(selecting) == {}


def test_elements_of_a_constant_are_set_one_by_one():
    program = Compile(alone(Gain([2.0, 3.0])), **SHORT)
    changed = program.Run(**{"x.k(1)": 0.5, "x.k(0)": 4.0})
    same_rows(changed, simulate(alone(Gain([4.0, 0.5])), **SHORT))


def test_a_constant_is_refused_in_a_context():
    diagram = alone(Gain([2.0]))
    with pytest.raises(ScenarioError, match=r"x\.k = 3\.0: must be left to Compile"):
        SetNumbers(diagram, diagram.CreateDefaultContext(), {"x.k": 3.0})


def test_a_constant_that_drake_refuses_is_refused_by_its_name():
    program = Compile(alone(Saturation([-1.0], [1.0])), **SHORT)
    with pytest.raises(ScenarioError, match=r"^x\.min_value = .*: refused by Drake"):
        program.Run(**{"x.min_value": 2.0})


def test_a_run_with_other_constants_has_no_final_context():
    program = Compile(alone(Gain([2.0])), **SHORT)
    recording = program.Run(**{"x.k": 3.0})
    assert not hasattr(recording, "final_context") or recording.final_context is None
    assert any("no final_context" in note for note in recording.notes)


def touching(k=1.0):
    """Returns a field whose tool is at 0.5 k m; a layer begins at 1 m."""
    layer = LayerConfig(name="wall", start=1.0, stiffness=10.0)
    return Wired(
        {
            "field": LayeredForceField([layer], 1),
            "x": Gain([k]),
            "place": ConstantVectorSource([0.5]),
            "speed": ConstantVectorSource([0.0]),
        },
        {"x": "place", "field.tool_position": "x", "field.tool_velocity": "speed"},
    )


def test_the_initial_mode_follows_a_constant():
    recording = Compile(touching(), **SHORT).Run(**{"x.k": 4.0})
    assert recording["field.environment_force"][0] == 20.0
    same_rows(recording, simulate(touching(4.0), **SHORT))


class Doubled(LeafSystem):
    """y = 2 u, with a kernel that is compared with it."""

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


def test_a_constant_beside_an_own_block():
    program = Compile(driven(Gain([2.0]), Doubled(), names=["x", "own"]), **SHORT)
    expected = simulate(driven(Gain([5.0]), Doubled(), names=["x", "own"]), **SHORT)
    same_rows(program.Run(**{"x.k": 5.0}), expected)


def test_a_constant_has_a_slider():
    page = MakePage(pid(), duration=1.0, vary={"x.kp": (1.0, 9.0)})
    (slider,) = [x for x in page.data["inputs"] if x["name"] == "x.kp"]
    assert (slider["min"], slider["max"], slider["stops"]) == (1.0, 9.0, None)
