"""The thesis's controller: the block is the law, and the config derives its numbers."""

import numpy as np
import pytest
from block_checks import Block, Feedthrough, Gains, RandomInputs, backstepping_rate
from numpy.testing import assert_allclose, assert_array_equal

from teleop_drake import MakePage
from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    MAX_BASIS_FUNCTIONS,
    AdaptiveBackstepping,
    AdaptiveBacksteppingConfig,
    BacksteppingParameters,
    NetworkConfig,
)
from teleop_drake.model.laws.backstepping import (
    BacksteppingState,
    auxiliary_error,
    damped_force_error,
    pack_state,
)
from teleop_drake.model.laws.gaussian_network import GaussianNetwork, gaussian_functions
from teleop_drake.model.run.simulate import simulate
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.model.tasks.metrics import RunSummary
from teleop_drake.study.analysis.stability import AnalyzeStability


def Network(n):
    return GaussianNetwork(lower=[-1.0] * n, upper=[1.0] * n, count=[5] * n, width=1.0)


@pytest.mark.parametrize("n", [1, 2])
def test_the_block_is_the_law(n):
    gains = Gains(n)
    network = Network(n)
    block = AdaptiveBackstepping(gains=gains, network=network)
    N = network.num_functions
    inputs = RandomInputs(block, 0)
    rng = np.random.default_rng(1)
    state = BacksteppingState(
        rng.normal(size=n),
        rng.normal(size=(n, N)),
        4 * np.eye(n) + rng.uniform(-1, 1, (n, n)),
        rng.normal(size=(n, N)),
    )
    now = Block(block, inputs, pack_state(state))
    Phi, Phi_dot = gaussian_functions(
        inputs["tool_position"], inputs["tool_velocity"], *network.as_numbers()
    )
    signals = {
        "v": inputs["tool_velocity"],
        "v_dd": inputs["velocity_command"],
        "F_e": inputs["environment_force"],
        "F_hd": inputs["haptic_force"],
    }
    s = auxiliary_error(gains, **signals)
    expected = {
        "rate": pack_state(backstepping_rate(gains, state, Phi, Phi_dot, **signals)),
        "control_force": state.F_c,
        "psi": state.Psi.ravel(),
        "weights_1": state.W1.ravel(),
        "weights_3": state.W3.ravel(),
        "auxiliary_error": s,
        "control_force_error": damped_force_error(
            state, Phi, signals["F_e"], gains.G1 @ s
        ),
    }
    for name, value in expected.items():
        found = now.Rate() if name == "rate" else now[name]
        # Compiled, the law may round in another way.
        assert_allclose(found, value, rtol=1e-12, atol=1e-13, err_msg=name)


def test_start_ports_and_feedthrough_of_the_block():
    block = AdaptiveBackstepping(gains=Gains(2), network=Network(2))
    assert block.get_name() == "adaptive_backstepping"
    state = Block(block, {}).context.get_continuous_state_vector().CopyToVector()
    zeros = np.zeros(50)
    psi = Gains(2).Psi0.ravel()
    assert_array_equal(state, np.concatenate(([0, 0], zeros, psi, zeros)))
    ports = map(block.get_output_port, range(block.num_output_ports()))
    assert {port.get_name(): port.size() for port in ports} == {
        "control_force": 2,
        "psi": 4,
        "weights_1": 50,
        "weights_3": 50,
        "auxiliary_error": 2,
        "control_force_error": 2,
    }
    every_input = set(RandomInputs(block, 0))
    errors = ("auxiliary_error", "control_force_error")
    assert Feedthrough(block) == dict.fromkeys(errors, every_input)
    with pytest.raises(ValueError, match=r"network.num_inputs = 1: must be 2 or 4, on"):
        AdaptiveBackstepping(gains=Gains(2), network=Network(1))


def Config(n=2, **changes):
    network = NetworkConfig(lower=np.zeros(n), upper=np.ones(n), count=[3] * n)
    given = {"G1": 4.0, "G2": 20.0, "network": network}
    return AdaptiveBacksteppingConfig(**(given | changes))


def Facts(name="two_dof_combined"):
    return LoadScenario(name).Facts()


def test_numbers_stand_for_multiples_of_the_identity():
    G1 = np.array([[4.0, 1.0], [1.0, 3.0]])
    gains = Config(G1=G1, initial_psi=7.0).Resolve(Facts(), "controller")
    assert_array_equal(gains.G1, G1)
    assert_array_equal(gains.G2, 20 * np.eye(2))
    assert_array_equal(gains.Psi0, 7 * np.eye(2))
    assert (gains.beta1, gains.nu3, gains.Upsilon, gains.Psi_min) == (0.1, 0.1, 1, 0.1)


def test_each_law_may_have_a_rate_of_its_own():
    gains = Config(adaptation_rate=3.0, beta2=0.0).Resolve(Facts(), "controller")
    assert (gains.beta1, gains.beta2, gains.beta3) == (3.0, 0.0, 3.0)


def test_psi_derives_from_inertia_and_damping():
    """(I + Lambda D_e) M_r^-1 at the start pose (5.52)."""
    facts = Facts()
    Lambda = np.array([[2.0, 0.5], [0.5, 1.0]])
    gains = Config(Lambda=Lambda).Resolve(facts, "controller")
    weight = np.eye(2) + Lambda @ facts.environment_damping
    expected = weight @ np.linalg.inv(facts.inertia)
    assert_allclose(gains.Psi0, expected, rtol=1e-12)


def test_it_takes_its_parameters_from_what_has_them():
    parameters = BacksteppingParameters(G1=1.0, G2=2.0, leakage=0.7)
    config = AdaptiveBacksteppingConfig.Of(parameters)
    assert (config.G1, config.G2, config.leakage) == (1.0, 2.0, 0.7)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"G2": -1.0}, "controller.G2 = "),
        ({"Lambda": np.array([[1.0, 2.0], [2.0, 1.0]])}, "controller.Lambda = "),
        ({"P": np.diag([1.0, 100.0]), "G1": np.array([[1.0, 0.9], [0.9, 1.0]])},
         "controller.P = .*: must be such that the symmetric part of P G1 is pos"),
        ({"adaptation_rate": -0.1}, "controller.adaptation_rate = -0.1: must be"),
        ({"beta2": -0.1}, "controller.beta2 = -0.1: must be"),
        ({"leakage": -0.1}, "controller.leakage = -0.1: must be"),
        ({"supervision": 1.1}, "controller.supervision = 1.1: must be"),
        ({"minimum_psi": 0.0}, "controller.minimum_psi = 0.0: must be"),
        ({"network": NetworkConfig(lower=None, upper=None, count=None)},
         "controller.network.lower = null: must be"),
    ],
)  # fmt: skip
def test_what_is_refused(changes, message):
    with pytest.raises(ScenarioError, match=message):
        Config(**changes).Check("controller", 2)


@pytest.mark.parametrize("psi", [0.05, -3.0, np.diag([1.0, 0.01])])
def test_psi_has_to_be_invertible(psi):
    allowed = r"(auto, a positive number or a 2 x 2|larger than controller.minimum_psi)"
    message = rf"controller.initial_psi = .*: must be {allowed}"
    with pytest.raises(ScenarioError, match=message):
        Config(initial_psi=psi).Resolve(Facts(), "controller")


@pytest.mark.parametrize("minimum_psi", [1.2, 0.1])
def test_a_run_notes_that_psi_comes_to_its_limit(minimum_psi):
    overrides = {
        "duration": 0.114,
        "controller.adaptation_rate": 100.0,
        "controller.minimum_psi": minimum_psi,
    }
    recording = simulate(LoadScenario("two_dof_collision", overrides))
    notes = RunSummary(recording).get("notes", [])
    begin = "Psi comes to its limit, minimum_psi = 1.2 1/kg, at 0.11"
    assert [note.startswith(begin) for note in notes] == [True] * (minimum_psi == 1.2)


GIVEN = {"lower": np.array([0.0, 1.0]), "upper": np.array([1.0, 3.0]), "count": [3, 5]}


def Lattice(**changes):
    return NetworkConfig(**(GIVEN | changes))


def test_it_makes_the_network():
    config = Lattice(width=2.0)
    config.Check("network", 2)
    centres = config.MakeNetwork().centres
    assert centres.shape == (15, 2)
    assert sorted(set(centres[:, 0])) == [0.0, 0.5, 1.0]
    assert sorted(set(centres[:, 1])) == [1.0, 1.5, 2.0, 2.5, 3.0]


def test_whether_anything_is_given():
    nothing = NetworkConfig(lower=None, upper=None, count=None)
    assert not nothing.is_given
    assert NetworkConfig(lower=None, upper=None, count=[3]).is_given


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lower": np.array([0.0])}, "network.lower = "),
        ({"upper": np.array([1.0, np.nan])}, "network.upper = "),
        ({"upper": np.array([1.0, 1.0])}, r"network.upper = .*> network.lower = "),
        ({"count": [3]}, r"network.count = \[3\]: must be a list of 2 whole numbers"),
        ({"count": [3, 0]}, r"network.count = \[3, 0\]: must be a list of 2 whole"),
        ({"count": [MAX_BASIS_FUNCTIONS, 2]}, "network.count = .* at most 10000 in"),
        ({"width": 0.0}, "network.width = 0.0: must be"),
    ],
)
def test_lattices_that_are_refused(changes, message):
    with pytest.raises(ScenarioError, match=message):
        Lattice(**changes).Check("network", 2)


WITH_VELOCITY = {
    "controller.network.inputs": "position_velocity",
    "controller.network.velocity_range": 0.002,
    "controller.adaptation_rate": 50.0,  # So that the networks matter.
}


@pytest.mark.slow
def test_velocity_as_an_input_of_the_networks():
    """The engines agree, the analysis knows it, and it changes the run."""
    scenario = LoadScenario("one_dof", WITH_VELOCITY | {"duration": 0.5})
    times = np.linspace(0, 0.5, 61)
    runs = [simulate(scenario, engine=engine) for engine in ("drake", "compiled")]
    one, other = (run.Interpolate("weights_1", times) for run in runs)
    assert one.shape == (61, 5 * 3)
    assert_allclose(one, other, rtol=0, atol=1e-5 * np.abs(one).max())
    plain = simulate(
        LoadScenario(
            "one_dof",
            {**WITH_VELOCITY, "duration": 0.5, "controller.network.inputs": "position"},
        )
    )
    v = [run.Interpolate("tool_velocity", times) for run in (runs[0], plain)]
    assert np.abs(v[0] - v[1]).max() > 1e-6
    assert AnalyzeStability(scenario).points


@pytest.mark.slow
def test_a_page_with_velocity_as_an_input():
    assert MakePage(
        "one_dof", overrides=WITH_VELOCITY, controllers=["adaptive_backstepping"]
    )


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("one_dof", {"velocity_range": None}, "velocity_range = null: must be a speed"),
        ("one_dof", {"inputs": "speed"}, "inputs = 'speed': must be one of pos"),
        ("one_dof", {"velocity_count": 0}, "velocity_count = 0: must be >= 1"),
        ("network_tracking_linear", {}, "inputs = 'position_velocity': must be posit"),
    ],
)
def test_inputs_that_are_refused(name, changes, message):
    changes = {"inputs": "position_velocity", "velocity_range": 1.0} | changes
    overrides = {f"controller.network.{key}": x for key, x in changes.items()}
    with pytest.raises(ScenarioError, match=f"controller.network.{message}"):
        LoadScenario(name, overrides)
