"""Model files as plants."""

import numpy as np
import pytest

from teleop_drake.robots.model_file import LoadModel, NewPlant, ReadModel


@pytest.mark.parametrize(("name", "num_joints"), [("slider", 1), ("two_link_arm", 2)])
def test_models_of_the_package(name, num_joints):
    plant = LoadModel(ReadModel(name))
    assert plant.is_finalized() and plant.time_step() == 0
    assert plant.get_name() == "plant"
    assert plant.num_velocities() == plant.num_actuators() == num_joints
    assert plant.HasBodyNamed("tool")


@pytest.mark.parametrize("gravity", [[1.0], [0.0, -2.0], [0.0, 0.0, 3.0]])
def test_gravity_is_along_the_first_axes(gravity):
    plant = LoadModel(ReadModel("slider"), gravity)
    vector = plant.gravity_field().gravity_vector()
    np.testing.assert_array_equal(vector, np.pad(gravity, (0, 3 - len(gravity))))


def test_a_plant_is_finalized_at_the_end():
    with NewPlant() as plant:
        assert not plant.is_finalized()
    assert plant.is_finalized()
    assert np.linalg.norm(plant.gravity_field().gravity_vector()) > 9
