"""Transparency and absolute stability of the loop that the operator feels.

The teleoperator is a two-port between the operator's hand and the environment. Its
admittance matrix y(j w), (2n, 2n), is computed from the linear models of both sides and
the exact delays between them:

    [v_m; -v_s] = y [F_h; F_e]                                                   (1)

F_h is the force at the hand, where the velocity v_m is felt. F_e is the force of the
tool on the environment, and v_s the velocity of the tool. The powers F_h . v_m and
-F_e . v_s flow into the two-port. With an environment F_e = Z_e v_s at its far end, the
operator feels the one-port F_h = Z_to v_m.

The tool is at rest here: the model of a moving arm at one instant is not passive, even
if the arm itself is passive.

Sources: B. Hannaford, "A design framework for teleoperators with kinesthetic
feedback", IEEE Trans. Robot. Autom. 5 (1989); D. A. Lawrence, "Stability and
transparency in bilateral teleoperation", IEEE Trans. Robot. Autom. 9 (1993).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.loops.framework.arrays import Array, ComplexArray, Record
from teleop_drake.model.laws.two_port import llewellyn
from teleop_drake.model.scenario import AsTeleoperation, Scenario, ScenarioLike
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoint, OperatingPoints


def TransmittedImpedance(admittance: ArrayLike, load: ArrayLike) -> ComplexArray:
    """Returns the impedance Z_to(j w) that the operator feels (K, n, n).

        Z_to = [y11 - y12 Z_e (1 + y22 Z_e)^-1 y21]^-1

    It is infinite where the hand cannot be moved. Where Re Z_to < 0, energy flows to
    the operator.

    Args:
        admittance: y of (1) (K, 2n, 2n).
        load: Z_e in N s/m at the same frequencies (K, n, n).
    """
    y = np.asarray(admittance)
    Z_e = np.asarray(load)
    n = y.shape[1] // 2
    y11 = y[:, :n, :n]
    y12 = y[:, :n, n:]
    y21 = y[:, n:, :n]
    y22 = y[:, n:, n:]
    felt = y11 - y12 @ Z_e @ np.linalg.solve(np.eye(n) + y22 @ Z_e, y21)
    return np.linalg.inv(felt).astype(complex)


def EnvironmentImpedance(
    scenario: Scenario, point: OperatingPoint, frequencies: ArrayLike
) -> ComplexArray:
    """Returns Z_e(j w) = d_e + k_e/(j w) of the environment (K, n, n), (2.14).

    Args:
        scenario: A scenario with this environment.
        point: The operating point; its velocity has no effect.
        frequencies: w in rad/s (K), > 0.
    """
    w = np.asarray(frequencies, dtype=float).reshape(-1)
    stiffness, damping = scenario.environment.StiffnessAndDamping(point.position)
    return damping + stiffness / (1j * w[:, np.newaxis, np.newaxis])


@dataclass(frozen=True, kw_only=True, eq=False)
class Transparency:
    """The impedance that the operator feels at an operating point.

    Attributes:
        point: The operating point.
        frequencies: w in rad/s (K).
        transmitted: Z_to with the scenario's delays, N s/m (K, n, n).
        undelayed: Z_to without delay, N s/m (K, n, n).
        environment: Z_e, N s/m (K, n, n).
        llewellyn: Llewellyn's parameter of each axis (K, n), with the scenario's delays
            and no force on the other axes. Absolute stability requires 1 or more at
            every frequency.
        idle_passivity: Whether the model assumes passivity controllers that inject
            nothing. It then gives no information on the architecture's passivity.
    """

    point: OperatingPoint
    frequencies: Array
    transmitted: ComplexArray
    undelayed: ComplexArray
    environment: ComplexArray
    llewellyn: Array
    idle_passivity: bool

    @property
    def is_absolutely_stable(self) -> bool | None:
        """Whether the two-port is absolutely stable; None if `idle_passivity`."""
        if self.idle_passivity:
            return None
        return bool(self.llewellyn.min() >= 1 - _ROUNDING)

    def ToRecord(self) -> Record:
        """Returns a JSON object with the least Llewellyn parameter of each axis."""
        least = self.llewellyn.argmin(axis=0)
        eta = self.llewellyn.min(axis=0)
        return {
            "name": self.point.name,
            # JSON has no infinity. Null stands for -infinity, a port that generates
            # energy by itself, and for +infinity.
            "least_llewellyn": [x if np.isfinite(x) else None for x in eta.tolist()],
            "at_frequency": self.frequencies[least].tolist(),
            "absolutely_stable": self.is_absolutely_stable,
        }


# How much less than 1 Llewellyn's parameter may be by rounding.
_ROUNDING = 1e-6

FREQUENCIES = np.geomspace(0.01, 100.0, 600)
"""The default frequencies of an analysis of transparency, in rad/s."""


def AnalyzeTransparency(
    scenario: ScenarioLike,
    point: OperatingPoint,
    *,
    frequencies: ArrayLike = FREQUENCIES,
    linearizer: Linearizer | None = None,
) -> Transparency:
    """Analyses the impedance that the operator feels at an operating point.

    Args:
        scenario: A valid scenario, or its name or file. A delay that is not constant is
            replaced by a constant one; see ChannelConfig.AsConstantDelay.
        point: The operating point. Its position is used, with the tool at rest.
        frequencies: w in rad/s (K), > 0.
        linearizer: The scenario's Linearizer at its ports, to be reused for several
            points; None makes one.

    Raises:
        ScenarioError: If a channel is not a delay.
        ValueError: As in Linearizer.
    """
    scenario = AsTeleoperation(scenario)
    point = replace(
        point,
        velocity=0 * point.velocity,
        holds_force=False,
    )
    w = np.asarray(frequencies, dtype=float).reshape(-1)
    linearizer = linearizer or Linearizer(scenario, at_ports=True)
    model = linearizer.TwoPort(point)
    forward, back = (x.delay for x in scenario.ConstantDelays())
    delayed = model.Admittance(w, forward_delay=forward, return_delay=back)
    Z_e = EnvironmentImpedance(scenario, point, w)
    n = len(point.position)
    return Transparency(
        point=point,
        frequencies=w,
        transmitted=TransmittedImpedance(delayed, Z_e),
        undelayed=TransmittedImpedance(model.Admittance(w), Z_e),
        environment=Z_e,
        llewellyn=np.stack(
            [llewellyn(delayed[:, i::n, i::n]) for i in range(n)], axis=1
        ),
        idle_passivity=model.idle_passivity,
    )


def FeltStiffness(
    scenario: Scenario, point: OperatingPoint, frequencies: ArrayLike
) -> Array:
    """Returns the stiffness along x that the operator feels (K) in N/m.

        k(w) = Re j w / Y_xx(j w),   Y = Z_to^-1

    It is the part of the force that is in phase with the motion of the hand, while no
    force is applied along the other axes. A hand that holds a spring k_e feels k_e. For
    slow motions, on a layer of stiffness k_e, the stiffness is

        direct force                    k_e; also with every other law whose slave
                                        finally exerts the force of the hand and
                                        whose hand follows the tool
        wave variables                  k_e in series with 2 b / T: a transmission
                                        line with the round trip T is a spring itself
        proportional damping            k_e in series with K

    At higher frequencies the delay turns the phase, so a felt stiffness is one number
    only together with its frequency. Direct force with the round trip T, on a tool of
    mass m and damping d:

        k(w) = (k_e - m w^2) cos(w T) - d w sin(w T),   about k_e cos(w T) if w is small

    With k(w) < 0 the force changes as if the layer pulled the hand in.

    Args:
        scenario: A valid scenario.
        point: The operating point, with the tool at rest.
        frequencies: w in rad/s (K), > 0.

    Raises:
        ValueError: As in AnalyzeTransparency().
    """
    felt = AnalyzeTransparency(scenario, point, frequencies=frequencies)
    admittance = np.linalg.inv(felt.transmitted)[:, 0, 0]
    return (1j * felt.frequencies / admittance).real


def FeltStiffnessLoss(scenario: Scenario) -> float:
    """Returns |1 - k/k_e|, where k is the stiffness felt at 1 rad/s along x.

    k_e is the stiffness of the environment at the last operating point. The result is 0
    if the felt stiffness is k_e, and 1 if it is 0 or 2 k_e. Above 1 the felt stiffness
    is negative or more than 2 k_e.

    Raises:
        ValueError: If there is no linear model.
    """
    point = OperatingPoints(scenario)[-1]
    stiffness, _ = scenario.environment.StiffnessAndDamping(point.position)
    return abs(1.0 - float(FeltStiffness(scenario, point, [1.0])[0] / stiffness[0, 0]))
