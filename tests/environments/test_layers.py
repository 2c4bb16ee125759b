"""Tests of the kind `layers`."""

import numpy as np
import pytest

from teleop_drake.environments import LayerConfig, LayersEnvironmentConfig
from teleop_drake.environments.layered_force_field import LayeredForceField
from teleop_drake.scenario import LoadScenario
from teleop_drake.validation import ScenarioError


def Layers(**last):
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
    block = Layers().MakeEnvironment(start)
    assert isinstance(block, LayeredForceField)
    told = [surface.ToRecord() for surface in block.Surfaces()]
    assert told == [x.ToRecord() for x in Layers().Surfaces(start)]
    assert [x["name"] for x in told] == ["tissue", "puncture", "contact"]
    assert [x["point_W"][0] for x in told] == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    ("last", "message"),
    [
        ({"name": "free"}, "layers.2.name = 'free': must be unique"),
        ({"start": 0.1}, "layers.bone.start = 0.1: must be > 0.1 m"),
        ({"stiffness": -1.0}, "layers.bone.stiffness = -1.0: must be a finite number"),
        ({"damping": np.inf}, "layers.bone.damping = inf: must be a finite number"),
        ({"lateral_stiffness": -1.0}, "layers.bone.lateral_stiffness = -1.0: must be"),
    ],
)
def test_refuses(last, message):
    with pytest.raises(ScenarioError) as error:
        Layers(**last).Check()
    assert str(error.value).startswith(message)


@pytest.mark.parametrize("direction", [[0.0, 0.0], [np.nan, 1.0]])
def test_refuses_what_is_no_direction(direction):
    layers = Layers()
    layers.direction = np.array(direction)
    with pytest.raises(ScenarioError, match=r"^direction = "):
        layers.Check()


def test_refuses_a_direction_of_other_axes():
    with pytest.raises(ScenarioError, match=r"^environment.direction = .* 2 finite"):
        LoadScenario("two_dof_collision", ["environment.direction=[1, 0, 0]"])


def test_the_tool_starts_inside_along_the_direction():
    layers = Layers()
    layers.direction = np.array([0.0, -2.0])
    assert layers.Surfaces([9.0, 0.5])[0].name == "tissue"
    skin = Layers()
    skin.layers, skin.direction = skin.layers[:1], layers.direction
    assert [x.name for x in skin.Surfaces([9.0, 0.5])] == ["contact"]
    assert [x.name for x in skin.Surfaces([9.0, -0.5])] == ["tissue"]
