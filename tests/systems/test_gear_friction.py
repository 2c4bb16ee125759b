"""The block of the gears' friction."""

import pytest

from teleop_drake.compiler.check import CheckKernel
from teleop_drake.systems.gear_friction import GearFriction


def test_its_kernel_is_the_law():
    block = GearFriction(num_axes=2, coulomb=0.3, speed=0.01, viscous=0.2)
    assert CheckKernel(block, num_states=3) == []
    context = block.CreateDefaultContext()
    block.GetInputPort("drive_force").FixValue(context, [1.0, 1.0])
    block.GetInputPort("tool_velocity").FixValue(context, [2.0, -2.0])
    force = block.get_output_port().Eval(context)
    assert force == pytest.approx([1 - 0.7, 1 + 0.7], rel=1e-4)


@pytest.mark.parametrize("name", ["coulomb", "speed", "viscous"])
def test_what_is_refused(name):
    given = {"coulomb": 0.1, "speed": 0.1, "viscous": 0.1, name: -1.0}
    with pytest.raises(ValueError, match=f"{name} = -1.0: must be a finite number >"):
        GearFriction(num_axes=1, **given)
