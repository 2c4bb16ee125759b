"""What the hand feels of a bone through an entry of the league, and its passivity."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from league.entries import Entry, Gains, OneAxis
from teleop_drake.loops.framework.arrays import Array, ComplexArray
from teleop_drake.model.laws.two_port import llewellyn
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoint, OperatingPoints
from teleop_drake.study.analysis.transparency import (
    EnvironmentImpedance,
    TransmittedImpedance,
)

BAND = np.geomspace(0.3, 10.0, 10)
"""Frequencies of a hand in rad/s."""

FREQUENCIES = np.geomspace(0.1, 30.0, 61)
"""Frequencies in rad/s at which what is felt is compared with the bone."""

FELT_DELAY = 0.1
"""Delay each way in s through which the table tells what is felt."""

TRAINING_DELAYS = (0.05, 0.15)
"""Delays each way of the training runs in s."""

TRAINING_BONES = (75.0, 150.0, 300.0)
"""Stiffnesses in N/m of the bones in the training runs."""

BONES = (150.0, 300.0, 600.0)
"""Stiffnesses in N/m of the bones for which the table tells what is lost."""

STIFF_WALL = 15_000.0
"""Stiffness in N/m of the wall for the Z-width, a hundred bones."""


class TwoPort:
    """The two-port between the hand and a bone of one_dof, with an entry.

    Attributes:
        idle_passivity: Whether passivity controllers are assumed to inject nothing.
    """

    def __init__(self, entry: Entry, gains: Gains, delay: float):
        self._scenario = OneAxis(entry, gains, delay)
        point = OperatingPoints(self._scenario)[-1]
        self._point: OperatingPoint = replace(
            point, velocity=0 * point.velocity, holds_force=False
        )
        linearizer = Linearizer(self._scenario, at_ports=True)
        self._model = linearizer.TwoPort(self._point)
        self.idle_passivity = self._model.idle_passivity

    def Admittance(self, frequencies: Array, delay: float) -> ComplexArray:
        """Returns the admittance matrices (K, 2, 2) with the delay in s each way."""
        return self._model.Admittance(
            frequencies, forward_delay=delay, return_delay=delay
        )

    def Environment(self, frequencies: Array, bone: float) -> ComplexArray:
        """Returns the impedance in N s/m (K) of a bone, its stiffness in N/m."""
        load = EnvironmentImpedance(self._scenario, self._point, frequencies)[:, 0, 0]
        # The two-port between hand and bone does not depend on the bone.
        own: Any = self._scenario.environment
        further = bone - float(own.layers[-1].stiffness)
        return np.asarray(load + further / (1j * frequencies))

    def Felt(self, frequencies: Array, delay: float, load: ArrayLike) -> ComplexArray:
        """Returns the impedance that the hand feels in N s/m (K) through the delay."""
        y = self.Admittance(frequencies, delay)
        return TransmittedImpedance(y, np.reshape(load, (-1, 1, 1)))[:, 0, 0]

    def LeastLlewellyn(self, frequencies: Array, delay: float) -> float:
        """Returns the least of Llewellyn's parameter; NaN if the model cannot tell."""
        if self.idle_passivity:
            return np.nan
        return float(llewellyn(self.Admittance(frequencies, delay)).min())

    def StiffnessLoss(self, frequencies: Array, delay: float, bone: float) -> Array:
        """Returns |1 - k(w)/k_e| at each frequency (K) of a bone k_e in N/m."""
        load = self.Environment(frequencies, bone)
        felt = (1j * frequencies * self.Felt(frequencies, delay, load)).real
        # The stiffness is the real part of j w / Y, and Y is 1 / Z.
        return np.abs(1 - felt / (1j * frequencies * load).real)


def Loss(entry: Entry, gains: Gains) -> float:
    """Returns the share of the bone's stiffness that is lost over BAND.

    It is the mean over the frequencies, and over the delays and bones of training.
    """
    losses = []
    model = None
    for delay in TRAINING_DELAYS:
        # Gains by rule derive from the delay.
        if model is None or not gains:
            model = TwoPort(entry, gains, delay)
        for bone in TRAINING_BONES:
            losses.append(model.StiffnessLoss(BAND, delay, bone).mean())
    return float(np.mean(losses))


def FeltRow(entry: Entry, member: str, gains: Gains) -> dict[str, Any]:
    """Returns the row of a member in league_felt.csv: one_dof on bone, 0.2 s.

    Its columns are: `loss_at_1` and `loss_in_band`, |1 - k/k_e| of the felt stiffness k
    at 1 rad/s and its mean over BAND, for each of BONES; `impedance_error`, the mean
    over the band of |Z_to - Z_e|/(|Z_to| + |Z_e|); `z_width`, the mean over the band of
    the decades between |Z_to| on STIFF_WALL and in free space; `llewellyn`, the least
    parameter of Llewellyn at FREQUENCIES, below 1 if some passive operator and
    environment make the loop unstable; `felt_by_bone`, |Z_to|/|Z_e| at FREQUENCIES.
    """
    port = TwoPort(entry, gains, FELT_DELAY)
    w = FREQUENCIES
    bone = port.Environment(w, BONES[0])
    felt = port.Felt(w, FELT_DELAY, bone)
    stiff = port.Felt(w, FELT_DELAY, STIFF_WALL / (1j * w))
    free = port.Felt(w, FELT_DELAY, 0 * w)
    error = np.abs(felt - bone) / (np.abs(felt) + np.abs(bone))
    width = np.log10(np.abs(stiff) / np.abs(free))
    in_band = (w >= BAND[0]) & (w <= BAND[-1])
    numbers = {}
    for name, at in (("loss_at_1", np.ones(1)), ("loss_in_band", BAND)):
        for k in BONES:
            lost = port.StiffnessLoss(at, FELT_DELAY, k).mean()
            numbers[name if k == BONES[0] else f"{name}_{k:g}"] = float(lost)
    numbers |= {
        "impedance_error": float(error[in_band].mean()),
        "z_width": float(width[in_band].mean()),
        "llewellyn": port.LeastLlewellyn(w, FELT_DELAY),
    }
    row: dict[str, Any] = {"architecture": entry.name, "member": member}
    row |= {name: float(f"{value:.4g}") for name, value in numbers.items()}
    row["passive_by_design"] = entry.passive
    ratio = np.abs(felt) / np.abs(bone)
    return row | {"felt_by_bone": " ".join(f"{x:.3g}" for x in ratio)}
