"""Time-domain passivity: a port releases no more energy than the other has received.

A channel with delay has two ports, each with a force and a velocity on every axis. The
power F v at a port is integrated separately for each direction,

    dE_in/dt = max(power into the channel, 0),   dE_out/dt = max(-power, 0)

The channel is passive for any delay if at each port E_out(t) <= E_0 + E_in, where E_in
is that of the other port when the received packet left it. The difference of both
sides, the energy that may still leave the channel, is the budget W.

Published controllers run at 1 kHz. Here they are continuous: the observers are
integrals, and the controllers are dampings that depend on the state. Sampled
controllers tend to this form at high rates. It has no error from sampling the power,
and the solver's steps need not end every millisecond.

The quantities of each axis (n) are the operator's force F_h and F_hd, its received
value, in N; the tool's velocity v in m/s, at the master as received; powers in W;
energies and the budget W in J; `horizon` in s; and `maximum` in the unit of the result.

Sources: B. Hannaford and J.-H. Ryu, "Time-domain passivity control of haptic
interfaces", IEEE Trans. Robotics and Automation 18 (2002); J.-H. Ryu, J. Artigas and
C. Preusche, "A passive bilateral control scheme for a teleoperator with time-varying
communication delay", Mechatronics 20 (2010).
"""

import numpy as np

from teleop_drake.loops.framework.arrays import Array


def injected_resistance(
    effort: Array, flow: Array, budget: Array, horizon: float, maximum: float
) -> Array:
    """Returns the resistance that a passivity controller injects, on each axis (n).

        r = (P - max(W, 0) / horizon) / flow^2, between 0 and its maximum

    with P = effort flow, the power that would leave the channel with r = 0. At the
    slave the effort is F_hd, the flow is v, and r is a damping in N s/m. At the master
    the effort is v, the flow is -F_h, and r is a mobility in m/(N s).

    If P exceeds W / horizon, the port releases only P - r flow^2 = W / horizon. Hence
    dW/dt >= -W / horizon, and W does not become negative. This is the passivity
    controller of Hannaford and Ryu without sampling: with the horizon as the sample
    period, theirs spends in each period the budget at its beginning. When r is at its
    maximum, W may become negative; received energy then first makes up for the deficit.

    Args:
        effort: The force or velocity that r reduces (n).
        flow: The velocity or force that r multiplies (n).
        budget: The energy W that may still leave the channel, J (n).
        horizon: The time over which the budget may be spent, s, > 0.
        maximum: The largest r, in the unit of power / flow^2.
    """
    excess = effort * flow - np.maximum(budget, 0.0) / horizon
    # An excess requires a flow, whose square may nevertheless underflow to 0.
    square = flow * flow
    is_active = (excess > 0) & (square > 0)
    r = np.where(is_active, excess / np.where(is_active, square, 1.0), 0.0)
    return np.minimum(r, maximum)


def energy_budget(initial: float, received: Array, spent: Array, scale: float) -> Array:
    """Returns the budget W of a port in J (n).

    Args:
        initial: Initial energy E_0 in J.
        received: Energy E_in of the other port as received, J (n).
        spent: Energy E_out of this port in units of `scale` (n).
        scale: Unit of energy in J.
    """
    return initial + received - scale * spent


def scaled_energy_rates(power: Array, scale: float) -> Array:
    """Returns [dE_in/dt; dE_out/dt] in 1/s, in units of the energy `scale` (2n)."""
    share = power / scale
    return np.maximum(np.concatenate((share, -share)), 0.0)


def passive_effort(effort: Array, resistance: Array, flow: Array) -> Array:
    """Returns the effort reduced by a resistance: effort - resistance flow (n)."""
    return effort - resistance * flow
