"""Tests of the layered force (2.14) to (2.16)."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from teleop_drake.laws.layered_force import (
    contact_position,
    layer_table,
    layered_force,
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


def test_force_of_a_layer():
    _, tissue, bone = layer_table([TISSUE, BONE])
    axis = np.array([[1.0, 0.0], [0.0, 0.2]])

    def Force(layer, x, v):
        return layered_force(layer, axis, np.array([x, 0.5]), np.array([v, 9.0]))

    # The force at the puncture: 0.01 N/m 7.5 mm + 0.5 N s/m 1 mm/s.
    assert Force(tissue, 0.0075, 0.001) == pytest.approx([5.75e-4, 0], rel=1e-12)
    # Across the axis a spring pulls the tool to it.
    assert Force(bone, 0.016, 1.0) == pytest.approx([0.15, 0.6])


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
