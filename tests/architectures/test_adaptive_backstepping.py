"""The thesis's controller as a config: what derives, and what is refused."""

import numpy as np
import pytest

from teleop_drake.architectures.adaptive_backstepping import (
    AdaptiveBackstepping,
    AdaptiveBacksteppingConfig,
    BacksteppingParameters,
)
from teleop_drake.architectures.lattice import NetworkConfig
from teleop_drake.scenario import LoadScenario
from teleop_drake.simulation import simulate
from teleop_drake.tasks.metrics import RunSummary
from teleop_drake.validation import ScenarioError


def Config(n=2, **changes):
    network = NetworkConfig(lower=np.zeros(n), upper=np.ones(n), count=[3] * n)
    given = {"G1": 4.0, "G2": 20.0, "network": network}
    return AdaptiveBacksteppingConfig(**(given | changes))


def Facts(name="two_dof_combined"):
    return LoadScenario(name).Facts()


def test_numbers_stand_for_multiples_of_the_identity():
    G1 = np.array([[4.0, 1.0], [1.0, 3.0]])
    gains = Config(G1=G1, initial_psi=7.0).Resolve(Facts(), "controller")
    np.testing.assert_array_equal(gains.G1, G1)
    np.testing.assert_array_equal(gains.G2, 20 * np.eye(2))
    np.testing.assert_array_equal(gains.Psi0, 7 * np.eye(2))
    assert (gains.beta1, gains.nu3, gains.Upsilon, gains.Psi_min) == (0.1, 0.1, 1, 0.1)


def test_each_law_may_have_a_rate_of_its_own():
    gains = Config(adaptation_rate=3.0, beta2=0.0).Resolve(Facts(), "controller")
    assert (gains.beta1, gains.beta2, gains.beta3) == (3.0, 0.0, 3.0)


def test_psi_derives_from_inertia_and_damping():
    """(I + Lambda D_e) M_r^-1 at the start pose (5.52)."""
    facts, Lambda = Facts(), np.array([[2.0, 0.5], [0.5, 1.0]])
    gains = Config(Lambda=Lambda).Resolve(facts, "controller")
    weight = np.eye(2) + Lambda @ facts.environment_damping
    expected = weight @ np.linalg.inv(facts.inertia)
    np.testing.assert_allclose(gains.Psi0, expected, rtol=1e-12)


def test_it_makes_the_law_with_its_network():
    law = Config().MakeControlLaw(Facts(), "controller")
    assert isinstance(law, AdaptiveBackstepping)
    assert law.GetOutputPort("weights_1").size() == 2 * 9


def test_it_takes_its_parameters_from_what_has_them():
    parameters = BacksteppingParameters(G1=1.0, G2=2.0, leakage=0.7)
    config = AdaptiveBacksteppingConfig.Of(parameters)
    assert (config.G1, config.G2, config.leakage) == (1.0, 2.0, 0.7)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"G2": -1.0}, "controller.G2 = "),
        ({"Lambda": np.array([[1.0, 2.0], [2.0, 1.0]])}, "controller.Lambda = "),
        (
            {"P": np.diag([1.0, 100.0]), "G1": np.array([[1.0, 0.9], [0.9, 1.0]])},
            "controller.P = .*: must be such that the symmetric part of P G1 is pos",
        ),
        ({"adaptation_rate": -0.1}, "controller.adaptation_rate = -0.1: must be"),
        ({"beta2": -0.1}, "controller.beta2 = -0.1: must be"),
        ({"leakage": -0.1}, "controller.leakage = -0.1: must be"),
        ({"supervision": 1.1}, "controller.supervision = 1.1: must be"),
        ({"minimum_psi": 0.0}, "controller.minimum_psi = 0.0: must be"),
        (
            {"network": NetworkConfig(lower=None, upper=None, count=None)},
            "controller.network.lower = null: must be",
        ),
    ],
)
def test_what_is_refused(changes, message):
    with pytest.raises(ScenarioError, match=message):
        Config(**changes).Check("controller", 2)


@pytest.mark.parametrize("psi", [0.05, -3.0, np.diag([1.0, 0.01])])
def test_psi_has_to_be_invertible(psi):
    message = r"controller.initial_psi = .*: must be auto, a positive number or a 2 x 2"
    with pytest.raises(ScenarioError, match=message):
        Config(initial_psi=psi).Resolve(Facts(), "controller")


@pytest.mark.parametrize("minimum_psi", [1.2, 0.1])
@pytest.mark.parametrize("engine", ["drake", "compiled"])
def test_a_run_notes_that_psi_comes_to_its_limit(engine, minimum_psi):
    overrides = {
        "duration": 0.114,
        "controller.adaptation_rate": 100.0,
        "controller.minimum_psi": minimum_psi,
    }
    recording = simulate(LoadScenario("two_dof_collision", overrides), engine=engine)
    notes = RunSummary(recording).get("notes", [])
    begin = "Psi comes to its limit, minimum_psi = 1.2 1/kg, at 0.11"
    assert [note.startswith(begin) for note in notes] == [True] * (minimum_psi == 1.2)
