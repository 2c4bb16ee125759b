"""Controls for driving: sliders and keys in Meshcat, or a gamepad."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat

from teleop_drake.driving.settings import Settings
from teleop_drake.figures.scene.scene import NewtonsOf
from teleop_drake.scenario import ARCHITECTURES, LayersEnvironmentConfig, Scenario

Array = NDArray[np.float64]

FULL_SPEED = 2.0
"""The fastest that a hand may command, in multiples of |surgeon.velocity|."""

_STEP = 0.25
_DEAD_ZONE = 0.1
_LONGEST_DELAY = 2.0

# Keys (decrement, increment) by task axis, and the gamepad's stick: its axis and sign.
_KEYS = (("ArrowLeft", "ArrowRight"), ("ArrowDown", "ArrowUp"), ("KeyS", "KeyW"))
_SIGNS = {"ArrowLeft": "←", "ArrowRight": "→", "ArrowDown": "↓", "ArrowUp": "↑"}
_STICKS = ((0, 1.0), (1, -1.0), (3, -1.0))

_RATE = "simulated s in a second"
_DELAY, _LOSS = "delay each way (s)", "packets lost (%)"
_STIFFNESS = "stiffness (times)"

LET_GO, START_AGAIN, END = "let go (Space)", "start again (R)", "end (Q)"


class Hand(Protocol):
    """What commands while one drives; MeshcatControls is one."""

    def Command(self, time: float) -> Array:
        """Returns the share of the full speed along each axis (n), -1 to 1."""

    def Wanted(self) -> Settings:
        """Returns the settings that are wanted now."""

    def WantsAnew(self) -> bool:
        """Returns whether the task is to begin from its start, once for each wish."""

    def WantsEnd(self) -> bool:
        """Returns whether it is enough."""

    def Show(self, force: Array, velocity: Array, rate: float) -> None:
        """Shows what is felt.

        Args:
            force: Of the device on the hand in N (n).
            velocity: That the hand feels in m/s (n).
            rate: Simulated s in a second.
        """


class MeshcatControls:
    """Sliders, buttons and keys in Meshcat, and a gamepad there.

    The hand: a slider for each of the first three axes, or the sticks of the gamepad
    where they are pushed further. The settings: sliders, and a button for each
    controller. What is felt: sliders that move by themselves.

    Args:
        meshcat: Where.
        settings: With which it begins.
        delay: That the scenario has, s.
        controllers: Kinds to choose from.
        num_axes: n.
        newtons: The force that a bar shows at its end, N.
        speed: The speed that a bar shows at its end, m/s.
        has_stiffness: Whether the stiffness may be changed.
        needs_gamepad: Whether only the gamepad commands.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        settings: Settings,
        *,
        delay: float,
        controllers: Sequence[str],
        num_axes: int,
        newtons: float,
        speed: float,
        has_stiffness: bool,
        needs_gamepad: bool = False,
    ):
        self._meshcat = meshcat
        self._settings = settings
        self._num_axes = num_axes
        self._has_stiffness = has_stiffness
        meshcat.DeleteAddedControls()
        axes = "xyz"[:num_axes]
        # In the order in which they are shown.
        self._hands: list[str] = []
        if not needs_gamepad:
            for axis, keys in zip(axes, _KEYS, strict=False):
                name = f"hand {axis} ({' '.join(_SIGNS.get(x, x[-1]) for x in keys)})"
                meshcat.AddSlider(name, -1.0, 1.0, _STEP, 0.0, *keys)
                self._hands.append(name)
        self._forces = [f"felt: force {x} (N)" for x in axes]
        self._speeds = [f"felt: speed {x} (m/s)" for x in axes]
        for names, size in ((self._forces, newtons), (self._speeds, speed)):
            for name in names:
                meshcat.AddSlider(name, -size, size, size / 1000, 0.0)
        meshcat.AddSlider(_RATE, 0.0, 2.0, 0.001, 0.0)
        # What the slider rounds the scenario's delay to is not a wish to change it.
        self._delay_shown = meshcat.AddSlider(
            _DELAY, 0.0, max(_LONGEST_DELAY, delay), 0.05, delay
        )
        meshcat.AddSlider(_LOSS, 0.0, 90.0, 5.0, 100 * settings.loss)
        if has_stiffness:
            meshcat.AddSlider(_STIFFNESS, 0.25, 4.0, 0.25, settings.stiffness)
        self._controllers = {f"use {kind}": kind for kind in controllers}
        buttons = {LET_GO: "Space", START_AGAIN: "KeyR", END: "KeyQ"}
        buttons |= dict.fromkeys(self._controllers, "")
        for name, key in buttons.items():
            meshcat.AddButton(name, key)
        self._clicks = dict.fromkeys(buttons, 0)

    def Command(self, time: float) -> Array:
        """Returns the share of the full speed along each axis (n), -1 to 1."""
        if self._IsClicked(LET_GO):
            for name in self._hands:
                self._meshcat.SetSliderValue(name, 0.0)
        command = np.zeros(self._num_axes)
        for axis, name in enumerate(self._hands):
            command[axis] = self._meshcat.GetSliderValue(name)
        gamepad = self._meshcat.GetGamepad()
        if gamepad.index is not None:
            for axis in range(min(self._num_axes, len(_STICKS))):
                stick, sign = _STICKS[axis]
                value = gamepad.axes[stick] * sign if stick < len(gamepad.axes) else 0.0
                if abs(value) > max(_DEAD_ZONE, abs(command[axis])):
                    command[axis] = np.clip(value, -1.0, 1.0)
        return command

    def HasGamepad(self) -> bool:
        """Returns whether the browser has told of a gamepad."""
        return self._meshcat.GetGamepad().index is not None

    def Wanted(self) -> Settings:
        """Returns the settings that are wanted now."""
        settings = self._settings
        for name, kind in self._controllers.items():
            if self._IsClicked(name):
                settings = replace(settings, controller=kind)
        delay = self._meshcat.GetSliderValue(_DELAY)
        if delay != self._delay_shown:
            self._delay_shown = delay
            settings = replace(settings, delay=round(delay, 6))
        loss = self._meshcat.GetSliderValue(_LOSS)
        settings = replace(settings, loss=round(loss / 100, 6))
        if self._has_stiffness:
            stiffness = self._meshcat.GetSliderValue(_STIFFNESS)
            settings = replace(settings, stiffness=stiffness)
        self._settings = settings
        return settings

    def WantsAnew(self) -> bool:
        """Returns whether the task is to begin from its start, once for each click."""
        return self._IsClicked(START_AGAIN)

    def WantsEnd(self) -> bool:
        """Returns whether it is enough."""
        return self._IsClicked(END)

    def Show(self, force: Array, velocity: Array, rate: float) -> None:
        """Shows what is felt; see Hand."""
        for names, values in ((self._forces, force), (self._speeds, velocity)):
            for name, value in zip(names, values, strict=False):
                self._meshcat.SetSliderValue(name, float(value))
        self._meshcat.SetSliderValue(_RATE, min(rate, 2.0))

    def _IsClicked(self, button: str) -> bool:
        """Returns whether a button was clicked since it was last asked."""
        before = self._clicks[button]
        self._clicks[button] = self._meshcat.GetButtonClicks(button)
        return self._clicks[button] > before


def MakeControls(
    meshcat: Meshcat, scenario: Scenario, *, needs_gamepad: bool = False
) -> MeshcatControls:
    """Makes the controls of a scenario.

    Args:
        meshcat: Where. Controls that are there already are deleted.
    """
    kind = scenario.controller.kind
    return MeshcatControls(
        meshcat,
        Settings(controller=kind),
        delay=float(scenario.forward_channel.delay),
        controllers=list(dict.fromkeys([*ARCHITECTURES, kind])),
        num_axes=scenario.num_axes,
        newtons=NewtonsOf(scenario),
        speed=FullSpeed(scenario),
        has_stiffness=isinstance(scenario.environment, LayersEnvironmentConfig),
        needs_gamepad=needs_gamepad,
    )


def FullSpeed(scenario: Scenario) -> float:
    """Returns the fastest that a hand may command along an axis, m/s."""
    return FULL_SPEED * float(np.linalg.norm(scenario.surgeon.velocity))
