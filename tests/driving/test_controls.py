"""Sliders, buttons and a gamepad, as the browser sends them."""

import struct

import pytest
from pydrake.geometry import Meshcat

from teleop_drake.driving.controls import LET_GO, START_AGAIN, MeshcatControls
from teleop_drake.driving.settings import Settings


def Pack(value):
    """Returns a value as MessagePack, as far as the browser uses it."""
    if isinstance(value, bool):
        return b"\xc3" if value else b"\xc2"
    if isinstance(value, float):
        return b"\xcb" + struct.pack(">d", value)
    if isinstance(value, int):
        return bytes([value])
    if isinstance(value, str):
        return bytes([0xD9, len(value)]) + value.encode()
    if isinstance(value, list):
        return bytes([0x90 | len(value)]) + b"".join(map(Pack, value))
    items = [Pack(key) + Pack(item) for key, item in value.items()]
    return bytes([0x80 | len(items)]) + b"".join(items)


@pytest.fixture(scope="module")
def meshcat():
    return Meshcat()


@pytest.fixture
def controls(meshcat):
    return MeshcatControls(
        meshcat,
        Settings(controller="direct_force"),
        delay=0.12,
        controllers=["direct_force", "wave_variables"],
        num_axes=2,
        newtons=1.0,
        speed=0.2,
        has_stiffness=True,
    )


def Click(meshcat, name):
    meshcat._InjectWebsocketMessage(message=Pack({"type": "button", "name": name}))


def test_sliders_of_the_hand(meshcat, controls):
    assert controls.Command(0.0).tolist() == [0, 0]
    meshcat.SetSliderValue("hand x (← →)", 0.75)
    meshcat.SetSliderValue("hand y (↓ ↑)", -1.0)
    assert controls.Command(0.1).tolist() == [0.75, -1]
    Click(meshcat, LET_GO)
    assert controls.Command(0.2).tolist() == [0, 0]


def test_a_stick_that_is_pushed_further_wins(meshcat, controls):
    meshcat.SetSliderValue("hand x (← →)", 0.5)
    gamepad = {"index": 0, "button_values": [0.0], "axes": [-0.8, 0.05, 0.0, 0.0]}
    message = Pack({"type": "gamepad", "name": "", "gamepad": gamepad})
    meshcat._InjectWebsocketMessage(message=message)
    assert controls.HasGamepad()
    # The second axis is within the dead zone.
    assert controls.Command(0.0).tolist() == pytest.approx([-0.8, 0.0])


def test_settings(meshcat, controls):
    # The slider rounds 0.12 s, and nobody has wished for that.
    assert controls.Wanted() == Settings(controller="direct_force")
    meshcat.SetSliderValue("delay each way (s)", 0.5)
    meshcat.SetSliderValue("packets lost (%)", 10.0)
    meshcat.SetSliderValue("stiffness (times)", 2.0)
    Click(meshcat, "use wave_variables")
    expected = Settings(controller="wave_variables", delay=0.5, loss=0.1, stiffness=2.0)
    assert controls.Wanted() == controls.Wanted() == expected
    assert [controls.WantsAnew(), controls.WantsEnd()] == [False, False]
    Click(meshcat, START_AGAIN)
    assert [controls.WantsAnew(), controls.WantsAnew()] == [True, False]


def test_bars(meshcat, controls):
    controls.Show([0.3, -5.0], [0.05, 0.0], 0.97)
    values = {
        name: meshcat.GetSliderValue(name)
        for name in ("felt: force x (N)", "felt: force y (N)", "felt: speed x (m/s)")
    }
    assert list(values.values()) == pytest.approx([0.3, -1.0, 0.05])
