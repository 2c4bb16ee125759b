"""The law of chapters 4 and 5 without tuning functions, for comparison.

Each stage of backstepping adapts by its own error: W1 and Psi by P s, W3 by z. With
tuning functions W1 and Psi adapt by P s + G1^T Psi^-T z instead (4.21, 5.20).
"""

from typing import Any

import numpy as np

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Config
from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBackstepping,
    AdaptiveBacksteppingConfig,
)
from teleop_drake.model.laws.backstepping import (
    BacksteppingGains,
    adaptive_errors,
    adaptive_rate,
    known,
    pack_state,
    unpack_state,
)


def SeparateRate(gains: BacksteppingGains, *taken: Any) -> Array:
    """Returns adaptive_rate() without the terms in z of the updates of W1 and Psi."""
    state, Phi, _, s, F_e = known(gains, *taken)
    rate = unpack_state(adaptive_rate(gains, *taken), len(s))
    Psi_inv = np.linalg.inv(state.Psi)
    offset = Psi_inv @ (state.W1 @ Phi + gains.G1 @ s)
    z = state.F_c - F_e + offset
    share = (gains.G1.T @ (Psi_inv.T @ z))[:, np.newaxis]
    W1 = gains.beta1 * share * Phi
    Psi = gains.beta2 * share * (state.F_c - F_e)
    # The rates of W1 and Psi are also terms of alpha' (4.31, 5.30).
    F_c = Psi_inv @ (Psi @ offset - W1 @ Phi)
    return pack_state(
        rate._replace(F_c=rate.F_c - F_c, W1=rate.W1 - W1, Psi=rate.Psi - Psi)
    )


class SeparateUpdates(AdaptiveBackstepping):
    """AdaptiveBackstepping with SeparateRate(); all else is the same.

    The limit of Psi (4.53, 5.53) does not account for the difference, so that Psi must
    not reach it.
    """

    law = ("separate_updates", SeparateRate, adaptive_errors)


@Config
class SeparateUpdatesConfig(AdaptiveBacksteppingConfig):
    """Chapters 4 and 5 without tuning functions."""

    kind = f"{__name__}:SeparateUpdatesConfig"
    block = SeparateUpdates
