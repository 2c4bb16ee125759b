"""Tests of the environment."""

import math

import numpy as np
import pytest
from block_checks import Feedthrough
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Gain,
    Integrator,
)
from sources import Step
from wired import Wired

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.environments.layered_force_field import (
    LayeredForceField,
    LayersEnvironmentConfig,
    layer_at,
    outside,
)
from teleop_drake.model.scenario import LayerConfig, LoadScenario


def Layers():
    return [
        LayerConfig(name="tissue", start=-math.inf, stiffness=0.01, damping=0.5),
        LayerConfig(name="free", start=0.0075),
        LayerConfig(name="bone", start=0.015, stiffness=150.0, reference=0.015),
    ]


def Force(x, v, *, layers=None, num_axes=2):
    dut = LayeredForceField(
        layers=Layers() if layers is None else layers, num_axes=num_axes
    )
    context = dut.CreateDefaultContext()
    p, velocity = np.full((2, num_axes), 3.0)
    p[0] = x
    velocity[0] = v
    dut.GetInputPort("tool_position").FixValue(context, p)
    dut.GetInputPort("tool_velocity").FixValue(context, velocity)
    force = dut.GetOutputPort("environment_force").Eval(context)
    assert np.all(force[1:] == 0)
    return force[0], dut.GetOutputPort("layer").Eval(context)[0]


@pytest.mark.parametrize("num_axes", [1, 2, 3])
@pytest.mark.parametrize(
    ("x", "v", "force", "layer"),
    [
        (0.005, 0.001, 0.01 * 0.005 + 0.5 * 0.001, 0),
        (-2.0, 0.0, -0.02, 0),
        (0.0075, 0.001, 0.0, 1),
        (0.010, 0.001, 0.0, 1),
        (0.0151, 0.001, 0.015, 2),
    ],
)
def test_force_of_each_layer(x, v, force, layer, num_axes):
    assert Force(x, v, num_axes=num_axes) == (pytest.approx(force), layer)


def test_oblique_layers_are_turned_ones():
    """The same force, turned; across it the lateral spring of the tissue."""
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    normal = turn[:, 0]
    axis_point = np.array([0.1, -0.2, 0.3])
    layers = Layers()
    layers[0].lateral_stiffness = 40.0
    oblique = LayeredForceField(
        layers=layers, num_axes=3, direction=3 * normal, axis_point=axis_point
    )
    CheckKernel(oblique, num_states=3)
    context = oblique.CreateDefaultContext()
    for x, v in [(0.005, 0.2), (0.010, 0.2), (0.016, 0.2)]:
        p = turn @ [x, 0.02, -0.03]
        v_WT = turn @ [v, 5.0, 7.0]
        oblique.GetInputPort("tool_position").FixValue(context, p)
        oblique.GetInputPort("tool_velocity").FixValue(context, v_WT)
        F_e = oblique.GetOutputPort("environment_force").Eval(context)
        offset = p - axis_point
        across = offset - (normal @ offset) * normal
        force, layer = Force(x, v)
        expected = force * normal + (layer == 0) * 40.0 * across
        assert_allclose(F_e, expected, rtol=1e-12, atol=1e-14)
    for surface, start in zip(oblique.Surfaces()[1:], (0.0075, 0.015), strict=True):
        assert_allclose(surface.normal_W, normal, rtol=1e-15)
        assert surface.Depth(start * normal + turn @ [0, 3, 4]) == pytest.approx(0)
    # The first has no beginning, and is more than a spring and a damper.
    tissue, _, bone = oblique.Surfaces()
    assert tissue.Depth([9.0, 9.0, 9.0]) == math.inf and tissue.material is None
    assert bone.material.stiffness == 150.0


def test_nothing_before_the_first_layer():
    layers = [LayerConfig(name="wall", start=1.0, stiffness=5.0, reference=1.0)]
    assert Force(0.5, 1.0, layers=layers) == (0.0, -1)
    assert Force(2.0, 1.0, layers=layers) == (5.0, 0)


def MakeMass(field, *, speed):
    """A unit mass thrown against the field: x'' = -F_e."""
    velocity = Integrator(np.array([speed]))
    position = Integrator(1)
    diagram = Wired(
        {
            "dut": field,
            "velocity": velocity,
            "position": position,
            "negative": Gain(-1.0, 1),
        },
        {
            "position": "velocity",
            "dut.tool_position": "position",
            "dut.tool_velocity": "velocity",
            "negative": "dut.environment_force",
            "velocity": "negative",
        },
    )
    return diagram, field, position, velocity


@pytest.mark.filterwarnings("ignore:.*no event is located")
@pytest.mark.parametrize("locate", [True, False])
def test_crossing_a_jump_is_integrated_accurately(locate):
    """Through damping 1 for one metre, then freely: closed form."""
    layers = [
        LayerConfig(name="oil", start=-math.inf, damping=1.0),
        LayerConfig(name="air", start=1.0),
    ]
    diagram, dut, position, velocity = MakeMass(
        LayeredForceField(layers=layers, num_axes=1), speed=2.0
    )
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5",
            accuracy=1e-10,
            use_error_control=True,
            max_step_size=0.5,
        ),
        simulator,
    )
    context = simulator.get_mutable_context()
    if locate:
        context.SetAccuracy(1e-6)
    simulator.AdvanceTo(3.0)
    # v = 2 - x in the oil, so x = 1 at t = ln 2 and v = 1 from there.
    assert velocity.get_output_port().Eval(velocity.GetMyContextFromRoot(context))[
        0
    ] == pytest.approx(1.0, abs=1e-8)
    assert position.get_output_port().Eval(position.GetMyContextFromRoot(context))[
        0
    ] == pytest.approx(1.0 + 3.0 - math.log(2), abs=1e-7)
    layer = dut.GetMyContextFromRoot(context).get_discrete_state_vector()[0]
    assert layer == (2 if locate else 1)


def test_tool_may_come_back():
    """A ball on a spring that hangs behind a border: in, out, and in again."""
    layers = [
        LayerConfig(name="air", start=-math.inf),
        LayerConfig(name="gel", start=1.0, stiffness=1.0, reference=0.0),
    ]
    diagram, dut, _, velocity = MakeMass(
        LayeredForceField(layers=layers, num_axes=1), speed=1.0
    )
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    context.SetAccuracy(1e-6)
    modes = set()
    simulator.set_monitor(
        lambda root: modes.add(
            dut.GetMyContextFromRoot(root).get_discrete_state_vector()[0]
        )
    )
    simulator.AdvanceTo(4.0)
    assert modes == {1.0, 2.0}
    # It is thrown back with the speed at which it came.
    assert velocity.get_output_port().Eval(velocity.GetMyContextFromRoot(context))[
        0
    ] == pytest.approx(-1.0, abs=1e-3)


def MovedBy(source, field):
    """Returns a Diagram of a field whose tool has one number as place and velocity."""
    return Wired(
        {"field": field, "source": source},
        {"field.tool_position": "source", "field.tool_velocity": "source"},
    )


def test_initial_layer_follows_the_initial_position():
    dut = LayeredForceField(layers=Layers(), num_axes=1)
    simulator = Simulator(MovedBy(ConstantVectorSource([0.01]), dut))
    simulator.get_mutable_context().SetAccuracy(1e-6)
    simulator.Initialize()
    context = dut.GetMyContextFromRoot(simulator.get_context())
    assert context.get_discrete_state_vector()[0] == 2
    assert dut.GetOutputPort("environment_force").Eval(context)[0] == 0


@pytest.mark.parametrize(
    ("before", "after", "layer"),
    [(0.5, 1.0, 2), (1.5, 1.0, 2), (1.5, np.nextafter(1.0, 0.0), 1), (0.5, 2.5, 3)],
)
def test_a_position_that_jumps(before, after, layer):
    """On a border the tool is in the layer that begins there, in both engines."""
    layers = [
        LayerConfig(name="air", start=-math.inf),
        LayerConfig(name="gel", start=1.0, stiffness=1.0, reference=0.0),
        LayerConfig(name="bone", start=2.0, stiffness=9.0, reference=0.0),
    ]
    dut = LayeredForceField(layers=layers, num_axes=1)
    step = Step(time=0.1, before=[before], after=[after])
    simulator = Simulator(MovedBy(step, dut))
    simulator.get_mutable_context().SetAccuracy(1e-6)
    simulator.AdvanceTo(0.2)
    context = dut.GetMyContextFromRoot(simulator.get_context())
    assert context.get_discrete_state_vector()[0] == layer
    parameters = dut.Kernel().parameters
    before, ends, axis = (parameters[name] for name in ("before", "ends", "axis"))
    p_WT = np.array([after])
    assert layer_at(parameters["layers"], axis, p_WT) == layer
    for mode in map(np.array, ([1], [2], [3])):
        assert (outside(before, ends, axis, mode, p_WT) >= 0) == (mode != layer)


def test_feedthrough():
    assert Feedthrough(LayeredForceField(layers=Layers(), num_axes=1)) == {
        "environment_force": {"tool_position", "tool_velocity"},
        "layer": {"tool_position"},
    }


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stiffness": math.nan}, "layers.bone.stiffness = nan"),
        ({"damping": -1.0}, "layers.bone.damping = -1.0"),
        ({"reference": math.inf}, "layers.bone.reference = inf"),
        ({"lateral_stiffness": -1.0}, "layers.bone.lateral_stiffness = -1.0"),
        ({"start": 0.0075}, "layers.bone.start = 0.0075"),
        ({"start": 0.001}, "layers.bone.start = 0.001"),
    ],
)
def test_bad_layers(change, message):
    layers = Layers()
    for name, value in change.items():
        setattr(layers[-1], name, value)
    with pytest.raises(ValueError, match=message):
        LayeredForceField(layers=layers, num_axes=1)


# The kind `layers`.


def Config(**last):
    return LayersEnvironmentConfig(
        layers=[
            LayerConfig(name="tissue", start=0.0, stiffness=0.01, damping=0.5),
            LayerConfig(name="free", start=0.1),
            LayerConfig(**({"name": "bone", "start": 0.2, "stiffness": 150.0} | last)),
        ]
    )


@pytest.mark.parametrize("n", [1, 2, 3])
def test_config_and_block_tell_the_same_surfaces(n):
    start = np.zeros(n)
    block = Config().MakeEnvironment(start)
    assert isinstance(block, LayeredForceField)
    told = block.Surfaces()
    assert str(told) == str(Config().Surfaces(start))
    assert [x.name for x in told] == ["tissue", "puncture", "contact"]
    assert [x.point_W[0] for x in told] == [0.0, 0.1, 0.2]


def test_refuses_a_direction_of_other_axes():
    with pytest.raises(ScenarioError, match=r"^environment.direction = .* 2 finite"):
        LoadScenario("two_dof_collision", ["environment.direction=[1, 0, 0]"])


def test_the_tool_starts_inside_along_the_direction():
    layers = Config()
    layers.direction = np.array([0.0, -2.0])
    assert layers.Surfaces([9.0, 0.5])[0].name == "tissue"
    skin = Config()
    skin.layers = skin.layers[:1]
    skin.direction = layers.direction
    assert [x.name for x in skin.Surfaces([9.0, 0.5])] == ["contact"]
    assert [x.name for x in skin.Surfaces([9.0, -0.5])] == ["tissue"]
