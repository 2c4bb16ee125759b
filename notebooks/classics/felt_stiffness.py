"""How stiff a wall feels through a delay.

With the round trip T, a hand that swings at w feels of a stiffness k

    direct force    k cos w T; with the tool (k - m w^2) cos w T - c w sin w T
    waves           k in series with 2 b/T, for w T << 1

where felt stiffness is the part of the force in phase with the position, Re j w F_h/v.
(Derived here: through a raw line Z_to = (m s + c + k/s) e^(s T), and the wave line has
the impedance of wave_line.) The line of waves as a spring is Niemeyer's and Slotine's
(2004); that a delay makes a spring feel like less is textbook control.
"""

import numpy as np

from classics import InPageStyle
from teleop_drake import LoadScenario, Scenario
from teleop_drake.study.analysis.operating_point import OperatingPoints
from teleop_drake.study.analysis.transparency import FeltStiffness
from teleop_drake.study.figures.style import COLORS, GREY, LINES, Figure

BONE = 150.0  # N/m
MASS, FRICTION = 0.5, 0.1  # of the slider, kg and N s/m
IMPEDANCE = 0.92  # N s/m
ROUND_TRIPS = (0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0)  # s


def MakeScenario(kind: str, round_trip: float) -> Scenario:
    """Returns the slider's task with an architecture and a round trip in s."""
    overrides = {"controller.kind": kind, "delay": round_trip / 2}
    return LoadScenario("one_dof", overrides)


def Felt(kind: str, round_trip: float, frequency: float = 1.0) -> float:
    """Returns the stiffness in N/m that is felt of the bone at a frequency in rad/s."""
    scenario = MakeScenario(kind, round_trip)
    point = OperatingPoints(scenario)[-1]
    return float(FeltStiffness(scenario, point, [frequency])[0])


def DirectOnPaper(round_trip: float, frequency: float = 1.0) -> float:
    """Returns what direct force lets feel, in N/m."""
    w, T = frequency, round_trip
    stiffness = (BONE - MASS * w**2) * np.cos(w * T)
    return float(stiffness - FRICTION * w * np.sin(w * T))


def WavesOnPaper(round_trip: float) -> float:
    """Returns what waves let a slow hand feel, in N/m."""
    line = 2 * IMPEDANCE / round_trip
    return BONE * line / (BONE + line)


@InPageStyle
def Draw() -> Figure:
    """Draws the felt stiffness against the delay and against the frequency."""
    figure = Figure(figsize=(7.0, 2.2))
    left, right = figure.subplots(1, 2)
    trips = np.linspace(0.02, 2.0, 200)
    by_name = {
        "direct force": ("direct_force", DirectOnPaper),
        "waves": ("wave_variables", WavesOnPaper),
    }
    for i, (name, (kind, on_paper)) in enumerate(by_name.items()):
        look = {"color": COLORS[i]}
        left.plot(trips, [on_paper(x) for x in trips], ls=LINES[i], **look)
        found = [Felt(kind, x) for x in ROUND_TRIPS]
        left.plot(ROUND_TRIPS, found, "o", ms=3.5, label=name, **look)
    left.axhline(0, color=GREY, lw=0.8)
    left.set(xlabel="round trip [s]", ylabel="felt stiffness [N/m]")
    left.set_title("at 1 rad/s")
    right.set_title("round trip 0.2 s")
    left.legend()
    w = np.linspace(0.1, 15, 100)
    for i, (name, (kind, _)) in enumerate(by_name.items()):
        scenario = MakeScenario(kind, 0.2)
        stiffness = FeltStiffness(scenario, OperatingPoints(scenario)[-1], w)
        right.plot(w, stiffness, ls=LINES[i], color=COLORS[i], label=name)
    right.axhline(0, color=GREY, lw=0.8)
    right.set(xlabel="frequency [rad/s]", ylabel="felt stiffness [N/m]")
    return figure
