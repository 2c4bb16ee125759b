"""Transparency: which signals have to travel? (Lawrence; Hashtrudi-Zaad, Salcudean.)

With Z_m, Z_s of the two devices, local controllers C_m, C_s, motion forward and back
(C1, C4), force back and forward (C2, C3) and local force (C5 at the slave, C6 at the
master), an environment Z_e is felt without delay as

    Z_to = [(Z_m + C_m) N + C1 (C2 Z_e + C4)] / [(1 + C6) N - C3 (C2 Z_e + C4)],
    N    = Z_s + C_s + (1 + C5) Z_e

(derived here from the equations of laws/four_channel.py). It is Z_e itself if

    C1 = Z_s + C_s,   C4 = -(Z_m + C_m),   C2 = 1 + C6,   C3 = 1 + C5.

So Lawrence's four channels are transparent with C5 = C6 = 0, and three are enough with
local force feedback: with C5 = -1 no force goes forward, with C6 = -1 none comes back.
Lawrence's position-position and position-force are not transparent. Z_m and Z_s contain
masses; without measured accelerations C1 and C4 have the dampings only, and then all of
this holds for slow motions.

Sources: D. A. Lawrence, "Stability and transparency in bilateral teleoperation", IEEE
Trans. Robotics and Automation 9 (1993); K. Hashtrudi-Zaad and S. E. Salcudean,
"Analysis of control architectures for teleoperation systems with impedance/admittance
master and slave manipulators", Int. J. Robotics Research 20 (2001), and "Transparency
in time-delayed systems and the effect of local force feedback for transparent
teleoperation", IEEE Trans. Robotics and Automation 18 (2002).
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from classics import InPageStyle
from teleop_drake import LoadScenario, Scenario
from teleop_drake.loops.framework.arrays import Array, ComplexArray
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.stability import AnalyzeStability
from teleop_drake.study.analysis.transparency import AnalyzeTransparency
from teleop_drake.study.figures.style import COLORS, LINES, Figure

BANDWIDTH = 50.0  # rad/s, of the local controllers
SETTINGS: dict[str, dict[str, Any]] = {
    "position-position": {"variant": "position_position"},
    "position-force": {"variant": "position_force"},
    "four channels": {},
    "three, no force forward": {"C3": 0.0, "C5": -1.0},
    "three, no force back": {"C2": 0.0, "C6": -1.0},
}
TRANSPARENT = tuple(SETTINGS)[2:]
LAYERS = ("tissue", "free", "bone")


def MakeScenario(name: str, delay: float = 0.0, **overrides: Any) -> Scenario:
    """Returns the slider's task with an architecture and a delay each way in s."""
    settings = SETTINGS[name] | {"bandwidth": BANDWIDTH}
    controller = {f"controller.four_channel.{key}": x for key, x in settings.items()}
    return LoadScenario(
        "one_dof",
        {"controller.kind": "four_channel", "delay": delay} | controller | overrides,
    )


def Felt(
    name: str, frequencies: ArrayLike, delay: float = 0.0, layer: str = "bone"
) -> tuple[ComplexArray, ComplexArray]:
    """Returns Z_to and Z_e in N s/m (K) in a layer, at frequencies in rad/s (K)."""
    scenario = MakeScenario(name, delay)
    point = next(x for x in OperatingPoints(scenario) if x.name == layer)
    found = AnalyzeTransparency(scenario, point, frequencies=frequencies)
    return found.transmitted[:, 0, 0], found.environment[:, 0, 0]


def Error(name: str, frequencies: ArrayLike, delay: float = 0.0) -> Array:
    """Returns |Z_to/Z_e - 1| on the bone (K)."""
    felt, real = Felt(name, frequencies, delay)
    return np.abs(felt / real - 1)


def StableUpTo(name: str) -> dict[str, float]:
    """Returns by layer up to which round trip in s the loop is stable.

    It is 0 if the loop is unstable without delay, and infinite if no delay is too long.
    """
    analysis = AnalyzeStability(MakeScenario(name, 0.01))
    found = {}
    for layer in LAYERS:
        point = analysis[layer]
        first, last = point.stable_delays[0]
        found[layer] = 0.0 if first > 0 else float(last)
        if last >= point.max_delay:
            found[layer] = np.inf
    return found


@InPageStyle
def Draw() -> Figure:
    """Draws how far what is felt is from the bone, and the delay margins."""
    figure = Figure(figsize=(7.0, 2.2))
    left, right = figure.subplots(1, 2)
    w = np.geomspace(0.1, 30, 60)
    for i, name in enumerate(SETTINGS):
        look = {"color": COLORS[(0, 1, 2, 3, 6)[i]], "lw": 1.1, "label": name}
        left.loglog(w, Error(name, w), ls=LINES[i % len(LINES)], **look)
        right.loglog(w, Error(name, w, delay=0.05), ls=LINES[i % len(LINES)], **look)
    left.set_title("without delay")
    right.set_title("0.1 s of round trip")
    for ax in (left, right):
        ax.set(ylim=(1e-4, 10), xlabel="frequency [rad/s]")
    left.set_ylabel(r"$|Z_{to}/Z_e - 1|$ on the bone")
    left.legend(fontsize=6)
    return figure
