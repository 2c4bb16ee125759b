"""The adaptive controller's block: the law, the whole law and nothing but the law."""

import numpy as np
import pytest
from blocks import Gains
from pydrake.systems.analysis import Simulator

from teleop_drake.architectures.adaptive_backstepping import AdaptiveBackstepping
from teleop_drake.laws.backstepping import (
    BacksteppingGains,
    BacksteppingState,
    auxiliary_error,
    backstepping_rate,
    control_force_error,
    pack_state,
)
from teleop_drake.laws.gaussian_network import GaussianNetwork

INPUTS = (
    "haptic_force",
    "velocity_command",
    "tool_position",
    "tool_velocity",
    "environment_force",
)


def _make_block(
    n: int,
) -> tuple[AdaptiveBackstepping, BacksteppingGains, GaussianNetwork]:
    gains = Gains(n)
    network = GaussianNetwork(
        lower=[-1.0] * n, upper=[1.0] * n, count=[5] * n, width=1.0
    )
    return AdaptiveBackstepping(gains=gains, network=network), gains, network


def _random_context(block, n, N, seed=0):
    rng = np.random.default_rng(seed)
    context = block.CreateDefaultContext()
    values = {name: rng.normal(size=n) for name in INPUTS}
    for name, value in values.items():
        block.GetInputPort(name).FixValue(context, value)
    state = BacksteppingState(
        rng.normal(size=n),
        rng.normal(size=(n, N)),
        4 * np.eye(n) + rng.uniform(-1, 1, (n, n)),
        rng.normal(size=(n, N)),
    )
    context.SetContinuousState(pack_state(state))
    return context, values, state


@pytest.mark.parametrize("n", [1, 2])
def test_derivatives_and_outputs_are_the_law(n):
    block, gains, network = _make_block(n)
    N = network.num_functions
    context, values, state = _random_context(block, n, N)
    Phi, Phi_dot = network.evaluate_with_rate(
        values["tool_position"], values["tool_velocity"]
    )
    signals = {
        "v": values["tool_velocity"],
        "v_dd": values["velocity_command"],
        "F_e": values["environment_force"],
        "F_hd": values["haptic_force"],
    }
    rate = backstepping_rate(gains, state, Phi=Phi, Phi_dot=Phi_dot, **signals)
    s = auxiliary_error(gains, **signals)
    z = control_force_error(gains, state, Phi=Phi, s=s, F_e=signals["F_e"])

    derivatives = block.EvalTimeDerivatives(context).CopyToVector()
    # Compiled, the law may round in another way.
    np.testing.assert_allclose(derivatives, pack_state(rate), rtol=1e-12, atol=1e-13)
    for name, expected in {
        "control_force": state.F_c,
        "psi": state.Psi.ravel(),
        "weights_1": state.W1.ravel(),
        "weights_3": state.W3.ravel(),
    }.items():
        np.testing.assert_array_equal(
            block.GetOutputPort(name).Eval(context), expected, err_msg=name
        )
    for name, expected in {"auxiliary_error": s, "control_force_error": z}.items():
        np.testing.assert_allclose(
            block.GetOutputPort(name).Eval(context),
            expected,
            rtol=1e-12,
            atol=1e-13,
            err_msg=name,
        )


def test_initial_state():
    block, gains, _ = _make_block(2)
    context = block.CreateDefaultContext()
    np.testing.assert_array_equal(
        context.get_continuous_state_vector().CopyToVector(),
        np.concatenate(([0, 0], np.zeros(50), gains.Psi0.ravel(), np.zeros(50))),
    )


def test_ports():
    block, _, network = _make_block(2)
    N = network.num_functions
    assert block.get_name() == "adaptive_backstepping"
    names = [block.get_input_port(i).get_name() for i in range(block.num_input_ports())]
    assert names == list(INPUTS)
    assert all(block.GetInputPort(name).size() == 2 for name in INPUTS)
    ports = map(block.get_output_port, range(block.num_output_ports()))
    assert {port.get_name(): port.size() for port in ports} == {
        "control_force": 2,
        "psi": 4,
        "weights_1": 2 * N,
        "weights_3": 2 * N,
        "auxiliary_error": 2,
        "control_force_error": 2,
    }


@pytest.mark.parametrize(
    ("output", "sources"),
    [
        ("control_force", set()),
        ("psi", set()),
        ("weights_1", set()),
        ("weights_3", set()),
        ("auxiliary_error", set(INPUTS)),
        ("control_force_error", set(INPUTS)),
    ],
)
def test_direct_feedthrough(output, sources):
    block, _, _ = _make_block(1)
    index = block.GetOutputPort(output).get_index()
    assert {
        name
        for name in INPUTS
        if block.HasDirectFeedthrough(block.GetInputPort(name).get_index(), index)
    } == sources


def test_clone_of_the_context_continues_identically():
    block, _, network = _make_block(2)
    context, _, _ = _random_context(block, 2, network.num_functions)
    simulator = Simulator(block, context)
    simulator.AdvanceTo(0.05)
    finals = []
    for _ in range(2):
        continued = Simulator(block, simulator.get_context().Clone())
        continued.AdvanceTo(0.1)
        finals.append(
            continued.get_context().get_continuous_state_vector().CopyToVector()
        )
    np.testing.assert_array_equal(*finals)
    assert not np.array_equal(
        finals[0], simulator.get_context().get_continuous_state_vector().CopyToVector()
    )


def test_network_of_another_size():
    _, gains, _ = _make_block(2)
    network = GaussianNetwork(lower=[0.0], upper=[1.0], count=[5], width=1.0)
    with pytest.raises(ValueError, match=r"network.num_inputs = 1: must be 2, one for"):
        AdaptiveBackstepping(gains=gains, network=network)
