"""Time-domain passivity: what a port may give is what the other port has taken.

A channel with delay has two ports, each with a force and a velocity on every axis. The
power F v at a port is split by its direction into what flows in and what flows out,

    dE_in/dt = max(power into the channel, 0),   dE_out/dt = max(-power, 0)

and the channel is passive for any delay if at each port E_out(t) <= E_0 + E_in of the
other port as it was when the packet left. What is left to give is the budget W.

The customary controllers run at 1 kHz. Here they are continuous: the observers are
integrals and the controllers dampings that depend on the state. That is what the
sampled ones tend to at high rates; it has no error of its own from sampling the
power, and leaves the solver its steps, which would otherwise end every millisecond.

On each axis (n): forces F_h of the operator and F_hd as it arrives in N, the tool's
velocity v in m/s (as it arrives at the master), powers in W, energies and the budget W
in J, `horizon` in s, `maximum` in the unit of the result.

Sources: B. Hannaford and J.-H. Ryu, "Time-domain passivity control of haptic
interfaces", IEEE Trans. Robotics and Automation 18 (2002); J.-H. Ryu, J. Artigas and
C. Preusche, "A passive bilateral control scheme for a teleoperator with time-varying
communication delay", Mechatronics 20 (2010).
"""

import numpy as np

from teleop_drake.arrays import Array


def injected_resistance(
    effort: Array, flow: Array, budget: Array, horizon: float, maximum: float
) -> Array:
    """Returns the resistance that a passivity controller injects, on each axis (n).

        r = (P - max(W, 0) / horizon) / flow^2, between 0 and its maximum

    with P = effort flow, what would leave without it. At the slave the effort is F_hd
    and the flow v, and r a damping in N s/m; at the master they are v and -F_h, and r
    is a mobility in m/(N s).

    A port that would give the power P gives P - r flow^2 = W / horizon instead where
    that is less, so that dW/dt >= -W / horizon and W does not become negative. This is
    the passivity controller of Hannaford and Ryu without its sampling: with the horizon
    as sample period, theirs spends in each period what there is at its beginning. At
    the maximum W may become negative; whatever comes in then pays that back first.

    Args:
        effort: What r takes from, a force or a velocity (n).
        flow: What r multiplies, a velocity or a force (n).
        budget: W, energy that may still leave, J (n).
        horizon: In s, > 0.
        maximum: Largest r, in the unit of power / flow^2.
    """
    excess = effort * flow - np.maximum(budget, 0.0) / horizon
    # Where there is an excess there is a flow, unless its square underflows.
    square = flow * flow
    is_active = (excess > 0) & (square > 0)
    r = np.where(is_active, excess / np.where(is_active, square, 1.0), 0.0)
    return np.minimum(r, maximum)


def energy_budget(initial: float, received: Array, spent: Array, scale: float) -> Array:
    """Returns the budget W of a port in J (n)."""
    return initial + received - scale * spent


def scaled_energy_rates(power: Array, scale: float) -> Array:
    """Returns [dE_in/dt; dE_out/dt] in 1/s, as shares of an energy (2n)."""
    share = power / scale
    return np.maximum(np.concatenate((share, -share)), 0.0)


def passive_effort(effort: Array, resistance: Array, flow: Array) -> Array:
    """Returns what is left of an effort behind a resistance (n)."""
    return effort - resistance * flow
