"""Blocks by themselves: what comes out of one, and what it depends on."""

import numpy as np

from teleop_drake.model.laws.backstepping import (
    BacksteppingGains,
    auxiliary_error,
    damped_rate,
)


def Gains(n, Psi_min=0.1):
    """Returns gains of the adaptive law, no two of which are alike."""
    I = np.eye(n)
    return BacksteppingGains(
        Lambda=1.5 * I,
        G1=4 * I,
        G2=30 * I,
        P=2 * I,
        beta1=0.1,
        beta2=0.2,
        beta3=0.3,
        nu1=0.4,
        nu3=0.5,
        Upsilon=0.6,
        Psi0=4 * I + 0.1,
        Psi_min=Psi_min,
    )


def backstepping_rate(gains, state, Phi, Phi_dot, v, v_dd, F_e, F_hd):
    """Returns the rate of the law of chapters 4 and 5, whose damping is G1 s."""
    s = auxiliary_error(gains, v, v_dd, F_e, F_hd)
    return damped_rate(gains, state, Phi, Phi_dot, s, F_e, gains.G1 @ s, gains.G1)


class Block:
    """A block in a Context of its own, with values at its inputs and in its state."""

    def __init__(self, system, inputs, state=None):
        self.system = system
        self.context = system.CreateDefaultContext()
        for name, value in inputs.items():
            system.GetInputPort(name).FixValue(self.context, np.array(value))
        if state is not None:
            self.context.SetContinuousState(state)

    def __getitem__(self, name):
        """Returns an output."""
        return self.system.GetOutputPort(name).Eval(self.context)

    def Rate(self):
        """Returns the derivatives of the continuous state."""
        return self.system.EvalTimeDerivatives(self.context).CopyToVector()


def Feedthrough(system):
    """Returns what depends directly on what: {output: {inputs}}, if it does on any."""
    pairs = {}
    for i in range(system.num_input_ports()):
        for j in range(system.num_output_ports()):
            if system.HasDirectFeedthrough(i, j):
                output = system.get_output_port(j).get_name()
                pairs.setdefault(output, set()).add(system.get_input_port(i).get_name())
    return pairs


def RandomInputs(system, seed):
    """Returns a value for each input port."""
    random = np.random.default_rng(seed)
    ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    return {port.get_name(): random.normal(size=port.size()) for port in ports}


def AssertFeedthroughIsReal(system, seed=0):
    """Changes each input in turn: only the outputs that may change do, and all do."""
    inputs = RandomInputs(system, seed)
    state = None
    if size := system.num_continuous_states():
        state = np.random.default_rng(seed + 1).normal(size=size)
    expected = Feedthrough(system)
    before = Block(system, inputs, state)
    found = {}
    for name, value in inputs.items():
        after = Block(system, inputs | {name: value + 1.0}, state)
        for i in range(system.num_output_ports()):
            output = system.get_output_port(i).get_name()
            if not np.array_equal(before[output], after[output]):
                found.setdefault(output, set()).add(name)
    assert found == expected
