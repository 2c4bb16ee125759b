"""Direct force application as an architecture."""

import numpy as np
from blocks import Block, Feedthrough, RandomInputs

from teleop_drake.architectures.direct_force import DirectForceConfig
from teleop_drake.scenario import LoadScenario


def test_the_force_acts_as_it_arrives():
    facts = LoadScenario("two_dof_combined").Facts()
    sides = DirectForceConfig().MakeArchitecture(facts, "controller")
    assert sides.master_side is None
    assert sides.initial_forward_packet == [0.0] * 4
    assert sides.initial_return_packet == [*facts.start, 0.0, 0.0]
    slave = sides.slave_side
    inputs = RandomInputs(slave, 1)
    now = Block(slave, inputs)
    np.testing.assert_array_equal(now["control_force"], inputs["forward_packet"][:2])
    sent = [*inputs["tool_position"], *inputs["tool_velocity"]]
    np.testing.assert_array_equal(now["return_packet"], sent)
    assert Feedthrough(slave) == {
        "control_force": {"forward_packet"},
        "return_packet": {"tool_position", "tool_velocity"},
    }
