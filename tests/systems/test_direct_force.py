"""Direct force application: a wire with the ports of a control law."""

import numpy as np
import pytest

from teleop_drake.architectures.direct_force import DirectForce


@pytest.mark.parametrize("num_axes", [1, 2])
def test_applies_the_haptic_force(num_axes):
    block = DirectForce(num_axes=num_axes)
    context = block.CreateDefaultContext()
    force = np.arange(1.0, num_axes + 1.0)
    # The other inputs need not be connected.
    block.GetInputPort("haptic_force").FixValue(context, force)
    np.testing.assert_array_equal(
        block.GetOutputPort("control_force").Eval(context), force
    )
    assert block.num_continuous_states() == 0


def test_ports_and_direct_feedthrough():
    block = DirectForce(num_axes=2)
    assert block.get_name() == "direct_force"
    names = [block.get_input_port(i).get_name() for i in range(5)]
    assert names == [
        "haptic_force",
        "velocity_command",
        "tool_position",
        "tool_velocity",
        "environment_force",
    ]
    assert block.num_input_ports() == 5
    assert block.num_output_ports() == 1
    assert [block.HasDirectFeedthrough(i, 0) for i in range(5)] == [True] + 4 * [False]


def test_bad_size():
    with pytest.raises(ValueError, match="num_axes = 0: must be a finite number >= 1"):
        DirectForce(num_axes=0)
