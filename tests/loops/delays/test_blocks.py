"""Every block of a channel: feedthrough, clones of its state, and what is refused."""

import math

import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.analysis import Simulator
from sources import Ramp

from teleop_drake.loops.delays.network import NetworkDelay
from teleop_drake.loops.delays.packet_network import PacketNetwork
from teleop_drake.loops.delays.packet_options import Jitter, Loss, Receiver
from teleop_drake.loops.delays.sampled import SampledDelay
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.loops.delays.variable import DelayProfile, Sinusoid, VariableDelay

WAVE = DelayProfile(delay=0.2, sinusoid=Sinusoid(amplitude=0.15, frequency=5.0))
NETWORK = PacketNetwork(
    profile=DelayProfile(delay=0.1),
    sample_period=0.01,
    jitter=Jitter(kind="gamma", std=0.03, minimum=0.05),
    loss=Loss(kind="burst", probability=0.2, burst_length=3),
)
BLOCKS = {
    TransportDelay: {"delay": 0.13},
    VariableDelay: {"profile": WAVE},
    SampledDelay: {"delay": 0.13, "sample_period": 0.05},
    NetworkDelay: {"network": NETWORK},
}
BLOCK = pytest.mark.parametrize("block", BLOCKS)


def Make(block, **arguments):
    return block(**({"size": 2} | BLOCKS[block] | arguments))


@pytest.mark.parametrize("block", [TransportDelay, SampledDelay])
def test_zero_delay_is_a_pass_through(block):
    dut = Make(block, delay=0.0)
    assert dut.HasDirectFeedthrough(0, 0)
    context = dut.CreateDefaultContext()
    assert context.num_total_states() == 0
    assert dut.NextJumpTime(context) == math.inf
    assert_allclose(Ramp(dut).Output(0.777), [0.777, 1.554])


@BLOCK
def test_cloned_context_continues_identically(block):
    ramp = Ramp(Make(block))
    ramp.Output(0.5)
    clone = ramp.simulator.get_context().Clone()
    # The original goes on in the meantime, without touching the clone.
    expected = ramp.Output(1.0)
    other = Simulator(ramp.simulator.get_system(), clone)
    other.AdvanceTo(1.0)
    other.AdvancePendingEvents()
    output = ramp.dut.get_output_port().Eval(ramp.dut.GetMyContextFromRoot(clone))
    assert_array_equal(output, expected)
    # And a run from the start again is the same.
    again = Simulator(ramp.simulator.get_system())
    again.AdvanceTo(1.0)
    again.AdvancePendingEvents()
    context = ramp.dut.GetMyContextFromRoot(again.get_context())
    assert_allclose(ramp.dut.get_output_port().Eval(context), expected, atol=1e-12)


@pytest.mark.parametrize("block", [TransportDelay, VariableDelay])
def test_evaluation_far_beyond_the_last_step_is_refused(block):
    ramp = Ramp(Make(block))
    ramp.Output(1.0)
    ramp.simulator.get_mutable_context().SetTime(2.0)
    with pytest.raises(RuntimeError, match=rf"{block.__name__} 'dut': .* at most"):
        ramp.Eval()


@BLOCK
def test_state_is_bounded(block):
    ramp = Ramp(Make(block))
    ramp.Output(6.0)
    state = ramp.context.get_abstract_state(0).get_value()
    held = state.times if hasattr(state, "times") else state.packets
    assert len(held) < 70


@pytest.mark.parametrize(
    ("block", "arguments", "message"),
    [
        *((block, {"size": 0}, "size = 0: must") for block in BLOCKS),
        *((block, {"initial_value": [1.0]}, "initial_value = .*: must be 2 numbers")
          for block in BLOCKS),
        *((block, {"delay": delay}, f"delay = {delay}: must")
          for block in (TransportDelay, SampledDelay)
          for delay in (-1.0, math.nan)),
        (TransportDelay, {"max_sample_interval": 0.2}, "interval = 0.2: must"),
        (TransportDelay, {"max_sample_interval": math.nan}, "interval = nan: must"),
        (VariableDelay, {"max_sample_interval": 0.06}, "interval = 0.06: must"),
        (VariableDelay, {"profile": DelayProfile(delay=0.0)}, "never less than 1e-06"),
        (VariableDelay, {"profile": DelayProfile(delay=0.1, drift=1.5)},
         "drift = 1.5: must be such"),
        (SampledDelay, {"sample_period": 0.2}, "= 0.2: must be at most the delay"),
        (SampledDelay, {"sample_period": 0.0}, "sample_period = 0.0: must"),
        (NetworkDelay, {"receiver": Receiver(policy="last")},
         "receiver.policy = 'last': must be one of newest, playout"),
        (NetworkDelay, {"receiver": Receiver(policy="playout", depth=-1)},
         "receiver.depth = -1: must be"),
        (NetworkDelay, {"receiver": Receiver(depth=0.1)},
         "receiver.depth = 0.1: must be 0 where"),
    ],
)  # fmt: skip
def test_bad_parameters(block, arguments, message):
    with pytest.raises(ValueError, match=message):
        Make(block, **arguments)
