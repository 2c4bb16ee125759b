"""P+d: the bound on its spring is sharp. (Lee and Spong; Nuno, Basanez and Ortega.)

Two bodies are tied by a spring K through delays, and braked by B_m and B_s. With the
round trip T they are stable whatever passive hand and environment hold them if

    4 B_m B_s > T^2 K^2

This is Nuno's condition for P+d; with equal brakes it is Lee's and Spong's, B > T K/2.
The bound is sharp. The impedances of the two-port are M s + B + K/s at each end and
-K e^(-s T_i)/s across, so that Llewellyn's parameter is

    eta = 2 B_m B_s w^2/K^2 + cos w T = mu (w T)^2/2 + cos w T,   mu = 4 B_m B_s/(T K)^2

and min eta >= 1 if and only if mu >= 1. (Derived here.) Below it there are bodies, in
nobody's hand and touching nothing, that vibrate ever more.

Sources: D. Lee and M. W. Spong, "Passive bilateral teleoperation with constant time
delay", IEEE Trans. Robotics 22 (2006); E. Nuno, L. Basanez and R. Ortega,
"Passivity-based control for bilateral teleoperation: a tutorial", Automatica 47 (2011).
"""

import math
from typing import Any

import numpy as np

from classics import InPageStyle
from teleop_drake import LoadScenario, Scenario
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.analysis.transparency import AnalyzeTransparency
from teleop_drake.study.figures.style import COLORS, GREY, LINES, Figure

BRAKE = 0.92  # N s/m, B_m and the slave's own damper
FRICTION = 0.1  # N s/m of the slider, which brakes it, too
ROUND_TRIP = 0.2  # s
# 4 B^2/(T K)^2 without the friction of the slider.
MARGINS = (2.0, 1.0, 0.8)
MASSES = (0.5, 1.0, 2.0, 5.0, 10.0)  # kg


def Stiffness(margin: float) -> float:
    """Returns K in N/m."""
    return 2 * BRAKE / (math.sqrt(margin) * ROUND_TRIP)


def MakeScenario(margin: float, **overrides: Any) -> Scenario:
    """Returns the slider on P+d with a margin."""
    key = "controller.proportional_damping."
    return LoadScenario(
        "one_dof",
        {
            "controller.kind": "proportional_damping",
            f"{key}stiffness": Stiffness(margin),
            f"{key}master_damping": BRAKE,
            f"{key}slave_damping": BRAKE,
            "delay": ROUND_TRIP / 2,
        }
        | overrides,
    )


def Llewellyn(margin: float, frequencies: Array) -> Array:
    """Returns Llewellyn's parameter of the package's loop at frequencies in rad/s."""
    scenario = MakeScenario(margin)
    point = OperatingPoints(scenario)[0]
    found = AnalyzeTransparency(scenario, point, frequencies=frequencies)
    return found.llewellyn[:, 0]


def LlewellynOnPaper(margin: float, frequencies: Array) -> Array:
    """Returns it by the equation above, with the friction of the slider."""
    brakes = BRAKE * (BRAKE + FRICTION)
    w = frequencies
    return 2 * brakes * w**2 / Stiffness(margin) ** 2 + np.cos(w * ROUND_TRIP)


def GrowthOfBodies(margin: float, mass: float) -> float:
    """Returns the real part in 1/s of the rightmost root of two free bodies.

    Neither hand nor tissue nor friction holds them. Their drift is no vibration, and
    no root of the loop.
    """
    key = "controller.proportional_damping."
    scenario = MakeScenario(
        margin,
        **{
            f"{key}master_mass": mass,
            "robot.mass": mass,
            "robot.damping": 0.0,
            "environment.layers": [],
            "haptic_device.numerator": [0.0],
            "haptic_device.denominator": [1.0],
        },
    )
    (point,) = AnalyzeStability(scenario).points
    root = point.RightmostRoot(ROUND_TRIP)
    assert root is not None
    return float(root.real)


@InPageStyle
def Draw() -> Figure:
    """Draws Llewellyn's parameter, and how fast bodies begin to vibrate."""
    figure = Figure(figsize=(7.0, 2.2))
    left, right = figure.subplots(1, 2)
    w = np.linspace(0.05, 12, 60)
    for i, margin in enumerate(MARGINS):
        look = {"color": COLORS[i]}
        left.plot(w, LlewellynOnPaper(margin, w), ls=LINES[i], **look)
        name = rf"$4 B^2 = {margin:g}\,(T K)^2$"
        left.plot(w[::3], Llewellyn(margin, w[::3]), "o", ms=3, label=name, **look)
    left.axhline(1, color=GREY, lw=0.8)
    left.set(xlim=(0, 18), ylim=(0.9, 1.6), xlabel="frequency [rad/s]")
    left.set_ylabel("Llewellyn's parameter")
    left.legend(loc="upper right")
    shares = np.linspace(0.7, 1.3, 13)
    for i, mass in enumerate((0.5, 2.0, 10.0)):
        growth = [GrowthOfBodies(margin, mass) for margin in shares]
        look = {"color": COLORS[i], "label": f"{mass:g} kg"}
        right.plot(shares, growth, ls=LINES[i], **look)
    right.axhline(0, color=GREY, lw=0.8)
    right.axvline(1, color=GREY, lw=0.8)
    right.set(xlabel=r"$4 B^2/(T K)^2$", ylabel="growth of a vibration [1/s]")
    right.legend(title="two bodies of")
    return figure
