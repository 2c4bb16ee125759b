"""Tests of the layered force (2.14) to (2.16)."""

import math
from dataclasses import dataclass

from teleop_drake.laws.layered_force import (
    contact_position,
    puncture_position,
)


@dataclass
class Layer:
    name: str
    start: float
    stiffness: float = 0.0
    damping: float = 0.0
    reference: float = 0.0
    lateral_stiffness: float = 0.0


TISSUE = Layer("tissue", -math.inf, 0.01, 0.5)
FREE = Layer("free", 0.0075)
BONE = Layer("bone", 0.015, 150.0, 0.0, 0.015, 2.0)


def test_positions_of_contact_and_puncture():
    layers = [TISSUE, FREE, BONE]
    assert contact_position(layers) == 0.015
    assert puncture_position(layers) == 0.0075
    assert contact_position([TISSUE, FREE]) is None
    assert puncture_position([FREE, BONE]) is None
    assert contact_position([]) is None
    assert puncture_position([]) is None
    # Skin is not what the operator calls contact where there is bone behind it.
    skin = Layer("skin", 0.001, 1.0)
    assert contact_position([Layer("air", 0.0), skin, FREE, BONE]) == 0.015
