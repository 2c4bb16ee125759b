"""The torque that carries an arm's weight."""

import numpy as np
from block_checks import Block
from numpy.testing import assert_allclose
from slopes import Slopes

from teleop_drake.model.blocks.robots import Puma560Config
from teleop_drake.model.blocks.systems.gravity_compensation import GravityCompensation


def test_it_is_the_slope_of_the_potential_energy():
    model = Puma560Config().LoadPlant([0, 0, -9.81])
    q = np.linspace(-0.5, 0.9, 6)
    context = model.CreateDefaultContext()

    def Energy(q):
        model.SetPositions(context, q)
        return model.CalcPotentialEnergy(context)

    state = {"plant_state": [*q, *np.ones(6)]}
    torque = Block(GravityCompensation(model=model), state)["gravity_torque"]
    slope = [(Energy(q + dq) - Energy(q - dq)) / 2e-5 for dq in 1e-5 * np.eye(6)]
    assert_allclose(torque, slope, atol=1e-6)
    assert np.abs(torque).max() > 10


def test_it_has_its_slopes():
    assert Slopes(GravityCompensation(Puma560Config().LoadPlant())) == "yes"
