"""Direct force application: a wire with the ports of a control law."""

import pytest
from block_checks import Block, Feedthrough, RandomInputs
from numpy.testing import assert_array_equal

from teleop_drake.model.blocks.architectures.base import LAW_INPUTS
from teleop_drake.model.blocks.architectures.direct_force import (
    DirectForce,
    DirectForceConfig,
)
from teleop_drake.model.scenario import LoadScenario


def test_the_force_acts_as_it_arrives():
    facts = LoadScenario("two_dof_combined").Facts()
    config = DirectForceConfig()
    # Nothing derives unless a config says so.
    assert not config.has_gains_of_delay
    assert vars(config.Resolve(facts, "controller")) == vars(config)
    sides = config.MakeArchitecture(facts, "controller")
    assert sides.master_side is None
    assert sides.initial_forward_packet == [0.0] * 4
    assert sides.initial_return_packet == [*facts.start, 0.0, 0.0]
    slave = sides.slave_side
    inputs = RandomInputs(slave, 1)
    now = Block(slave, inputs)
    assert_array_equal(now["control_force"], inputs["forward_packet"][:2])
    sent = [*inputs["tool_position"], *inputs["tool_velocity"]]
    assert_array_equal(now["return_packet"], sent)
    assert Feedthrough(slave) == {
        "control_force": {"forward_packet"},
        "return_packet": {"tool_position", "tool_velocity"},
    }


def test_ports():
    block = DirectForce(num_axes=2)
    assert block.get_name() == "direct_force"
    assert block.num_input_ports() == 5 and block.num_output_ports() == 1
    names = [block.get_input_port(i).get_name() for i in range(5)]
    assert names == list(LAW_INPUTS)
    # The other inputs need not be connected.
    now = Block(block, {"haptic_force": [1.0, 2.0]})
    assert_array_equal(now["control_force"], [1.0, 2.0])
    with pytest.raises(ValueError, match="num_axes = 0: must be a finite number >= 1"):
        DirectForce(num_axes=0)
