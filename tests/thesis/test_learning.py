"""What the networks learn, and what they cannot."""

import numpy as np
import pytest
from block_checks import backstepping_rate
from grids import Slow
from numpy.testing import assert_allclose
from pydrake.multibody.tree import JacobianWrtVariable

from teleop_drake.model.laws.backstepping import (
    BacksteppingGains,
    BacksteppingState,
)
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.thesis.claims.learning import (
    INSIDE,
    PathDistance,
    UnlearnedWeight,
    UnrepresentedShare,
    WeightDrift,
)
from teleop_drake.thesis.claims.measures import Rms, UnlearnedShare
from teleop_drake.thesis.runs import ADAPTIVE, LEARNING, NO_ADAPTATION, TASKS

pytestmark = pytest.mark.xdist_group("thesis")


@pytest.mark.parametrize("name", Slow(TASKS, but=[1]))
def test_networks_of_the_position_cannot_say_the_rate_of_a_spring(thesis_runs, name):
    """The best constant weights leave half of dF_e/dt or more; what is learned, all."""
    recording = thesis_runs(name, ADAPTIVE).recording
    by_place = UnrepresentedShare(recording)
    assert 0.45 < by_place <= 1.0
    assert UnrepresentedShare(recording, 5) < 0.6 * by_place
    assert UnlearnedShare(recording) > 0.99


@pytest.mark.slow
def test_where_they_learn_adaptation_matters(thesis_runs):
    run, silent = (thesis_runs(LEARNING, x).recording for x in ({}, NO_ADAPTATION))
    drift = WeightDrift(run.teleoperation, INSIDE)
    assert UnlearnedWeight(run, INSIDE, drift) < 0.25
    assert UnlearnedWeight(silent, INSIDE, drift) == 1.0
    assert Rms(run, PathDistance(run)) < 0.5 * Rms(silent, PathDistance(silent))


def test_what_the_weight_adds_is_the_closed_form():
    """(I + Lambda D_e) J M^-1 tau_g; D_e of the tissue acts along x alone."""
    scenario = LoadScenario(LEARNING)
    plant = scenario.robot.LoadPlant()
    context = plant.CreateDefaultContext()
    tool = plant.GetFrameByName("tool")
    world = plant.world_frame()
    for p, drift in zip(INSIDE, WeightDrift(scenario, INSIDE), strict=True):
        plant.SetPositions(context, scenario.robot.JointPositions(p))
        J = plant.CalcJacobianTranslationalVelocity(
            context, JacobianWrtVariable.kV, tool, np.zeros(3), world, world
        )[:2]
        tau_g = plant.CalcGravityGeneralizedForces(context)
        fall = J @ np.linalg.solve(plant.CalcMassMatrix(context), tau_g)
        assert_allclose(drift, [1.5, 1.0] * fall, rtol=1e-9)


def test_distance_from_the_path_is_how_far_the_start_is_missed(thesis_runs):
    """At the end the hand is where it began."""
    recording = thesis_runs(LEARNING).recording
    beside = PathDistance(recording)
    missed = recording["tool_position"][-1] - recording.scenario.robot.start
    assert beside[0] == pytest.approx(0.0, abs=1e-12)
    assert beside[-1] == pytest.approx(np.linalg.norm(missed), abs=1e-5)


@pytest.mark.parametrize("which", ["W1", "W3"])
def test_what_leakage_leaves_and_how_long_it_takes(which):
    """The formulas of the page, from the law with a constant unknown."""
    G1 = 4.0
    G2 = 30.0
    nu = 0.1
    beta = 0.1
    active = 1.6
    # Each network for itself, and so that s and z hardly move one another: an unknown
    # of ds/dt moves z unless Psi = G1.
    is_first = which == "W1"
    gain, psi = (G1, G1) if is_first else (G2, 1e-3)
    one = np.eye(1)
    gains = BacksteppingGains(
        Lambda=one, G1=G1 * one, G2=G2 * one, P=one,
        beta1=beta * is_first, beta2=0.0, beta3=beta * (not is_first),
        nu1=nu, nu3=nu, Upsilon=0.0, Psi0=psi * one, Psi_min=1e-4,
    )  # fmt: skip
    Phi = np.array([np.sqrt(active)])
    zero = np.zeros(1)

    def Rate(y, unknown=1.0):
        """The rate of [s, F_c - F_e, w], which is affine in them."""
        s, dF, w = y
        W1, W3 = (w, 0.0) if is_first else (0.0, w)
        state = BacksteppingState(
            np.array([dF]), np.array([[W1]]), gains.Psi0, np.array([[W3]])
        )
        rate = backstepping_rate(
            gains, state, Phi, zero, np.array([s]), zero, zero, zero
        )
        s_dot = psi * dF + unknown * is_first
        F_e_dot = unknown * (not is_first)
        w_dot = rate.W1 if is_first else rate.W3
        return np.array([s_dot, rate.F_c[0] - F_e_dot, w_dot[0, 0]])

    offset = Rate(np.zeros(3))
    A = np.column_stack([Rate(e, 0.0) for e in np.eye(3)])
    learned = np.sqrt(active) * np.linalg.solve(A, -offset)[2]
    assert 1 - learned == pytest.approx(nu * gain / (nu * gain + active), rel=1e-3)
    slowest = -np.linalg.eigvals(A).real.max()
    assert slowest == pytest.approx(beta * (active / gain + nu), rel=0.02)
