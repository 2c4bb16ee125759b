"""A sampled virtual wall: how stiff may it be? (Colgate, Schenkel and Brown.)

A computer reads the position x of a tool with the friction b every T, and holds the
force of a spring K and a damper B between two samples,

    F(t) = -K x_k - B (x_k - x_(k-1))/T    for k T <= t < (k + 1) T.

The tool is tied to both sides of x = 0. The wall is passive if and only if
b > K T/2 + |B|. That follows from the condition of Colgate and Schenkel for any law
H(z) of the sampled position,

    b > T/2 Re((1 - e^(-j w T)) H(e^(j w T)))/(1 - cos w T)    for 0 <= w <= pi/T,

which for H = K + B (z - 1)/(T z) reads b > K T/2 - B cos w T. A damper B > 0 is worst
at half the sampling rate, a negative one at w -> 0, where a spring alone always is.

Sources: J. E. Colgate and G. G. Schenkel, "Passivity of a class of sampled-data
systems: application to haptic interfaces", American Control Conference (1994) and J.
Robotic Systems 14 (1997); J. E. Colgate and J. M. Brown, "Factors affecting the Z-width
of a haptic display", IEEE ICRA (1994). The last equation and the conditions of two tied
joints are derived here and in tests/study/analysis/test_leader_follower.py.
"""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import LinearSystem, ZeroOrderHold
from scipy.optimize import brentq

from classics import InPageStyle
from teleop_drake import simulate
from teleop_drake.study.figures.style import COLORS, GREY, Figure

FRICTION = 1.0  # N s/m
PERIOD = 1e-3  # s
PERIODS = (0.5e-3, 1e-3, 2e-3, 4e-3)
# Tools that find out whether a wall is active, in kg: a heavy one swings slowly, and a
# light one jumps to and fro at half the sampling rate. And how many cycles it takes.
TOOLS = ((1.0, 2000), (1e-6, 16))
# How a computer closes the loop: number of joints, cycles of computing, and the
# friction that it needs, b/(K T).
WIRINGS = {
    "one joint, fixed wall": (1, 0, 1 / 2),
    "one joint, fixed wall, a cycle of computing": (1, 1, 3 / 2),
    "two joints, tied at both ends": (2, 0, 1.0),
    "two joints, tied at both ends, a cycle of computing": (2, 1, 3.0),
}


def MakeSampledLoop(
    *,
    K: float,
    B: float = 0.0,
    T: float = PERIOD,
    b: float = FRICTION,
    mass: float = 1.0,
    num_joints: int = 1,
    late_cycles: int = 0,
) -> Diagram:
    """Makes tools that are pushed against a sampled wall, or two that are tied by it.

    The first tool gets a push in the form of an initial velocity of 1 m/s.

    Args:
        K: Stiffness of the wall in N/m.
        B: Damping of the wall in N s/m.
        T: Period of the samples in s.
        b: Friction of each tool in N s/m.
        mass: Of each tool with the hand that holds it, in kg.
        num_joints: 1, or 2 that are tied to each other.
        late_cycles: How many cycles the force is late, 0 or 1.
    """
    joint = [[0, 1], [0, -b / mass]]
    each = np.eye(num_joints)
    # What the wall, or the tie, makes of the positions.
    tie = np.array([[1]]) if num_joints == 1 else np.array([[1, -1], [-1, 1]])
    builder = DiagramBuilder()
    tools = builder.AddNamedSystem(
        "tools",
        LinearSystem(
            A=np.kron(each, joint),
            B=np.kron(each, [[0], [1 / mass]]),
            C=np.kron(each, [[1, 0]]),
        ),
    )
    tools.configure_default_state([0, 1, *[0] * (2 * num_joints - 2)])
    sampler = builder.AddNamedSystem("sampler", ZeroOrderHold(T, num_joints))
    wall = builder.AddNamedSystem(
        "wall",
        # Its state is the sample before.
        LinearSystem(
            A=0 * each, B=each, C=tie * B / T, D=-tie * (K + B / T), time_period=T
        ),
    )
    builder.Connect(tools.get_output_port(), sampler.get_input_port())
    builder.Connect(sampler.get_output_port(), wall.get_input_port())
    force = wall.get_output_port()
    if late_cycles:
        # It takes the force that is there before the other two are updated.
        computing = builder.AddNamedSystem("computing", ZeroOrderHold(T, num_joints))
        builder.Connect(force, computing.get_input_port())
        force = computing.get_output_port()
    builder.Connect(force, tools.get_input_port())
    builder.ExportOutput(tools.get_output_port(), "position")
    builder.ExportOutput(force, "force")
    diagram = builder.Build()
    diagram.set_name("sampled_wall")
    return diagram


def Growth(num_cycles: int = 2000, *, T: float = PERIOD, **loop: float) -> float:
    """Returns the logarithm of how much a simulated vibration grows in a run.

    Args:
        num_cycles: Length of the run in cycles.
        T: Period of the samples in s.
        loop: Of MakeSampledLoop().
    """
    end = num_cycles * T
    recording = simulate(MakeSampledLoop(T=T, **loop), duration=end)
    position = recording["position"]
    # Two joints also move together, which the tie does not see.
    swing = position[:, 0] - position[:, 1:].sum(axis=1)
    early = np.ptp(swing[recording.time < end / 4])
    late = np.ptp(swing[recording.time > 3 * end / 4])
    return float(np.log(late / early))


def IsPassive(K: float, B: float, T: float = PERIOD) -> bool:
    """Returns whether a wall makes none of the TOOLS swing more and more."""
    return all(
        Growth(num_cycles, K=K, B=B, T=T, mass=mass) < 0 for mass, num_cycles in TOOLS
    )


def LargestStiffness(T: float) -> float:
    """Returns the stiffness in N/m from which on a wall without damping shakes."""
    expected = 2 * FRICTION / T
    return brentq(lambda K: Growth(K=K, T=T), 0.9 * expected, 1.1 * expected, rtol=1e-4)


def LeastFriction(wiring: str, K: float = 1000.0) -> float:
    """Returns b/(K T) below which simulated joints shake."""
    num_joints, late_cycles, expected = WIRINGS[wiring]

    def Shakes(share: float) -> float:
        return Growth(
            K=K, b=share * K * PERIOD, num_joints=num_joints, late_cycles=late_cycles
        )

    return brentq(Shakes, 0.9 * expected, 1.1 * expected, rtol=1e-4)


@InPageStyle
def Draw() -> Figure:
    """Draws the plane of K and B at 1 kHz, and the stiffest wall against the rate."""
    figure = Figure(figsize=(7.0, 2.2))
    left, right = figure.subplots(1, 2)
    stiffest = 2 * FRICTION / PERIOD
    left.fill(
        [0, stiffest, 0], [-FRICTION, 0, FRICTION], color=COLORS[4], alpha=0.5, lw=0
    )
    for K in np.linspace(0.05, 1.05, 6) * stiffest:
        for B in np.linspace(-1.1, 1.1, 9) * FRICTION:
            is_passive = IsPassive(K, B)
            color, marker = (COLORS[0], "o") if is_passive else (COLORS[1], "x")
            left.plot(K, B, marker, color=color, ms=3.5)
    left.set(xlabel="stiffness K [N/m]", ylabel="damping B [N s/m]")
    left.set_title("blue: b > K T/2 + |B|; dots rest, crosses shake")
    rates = np.array([200.0, 2200.0])
    right.plot(rates, 2 * FRICTION * rates, color=GREY, label="2 b/T")
    found = [LargestStiffness(T) for T in PERIODS]
    right.plot(1 / np.array(PERIODS), found, "o", color=COLORS[0], label="simulated")
    right.set(xlabel="sampling rate [Hz]", ylabel="stiffest wall [N/m]")
    right.legend()
    return figure
