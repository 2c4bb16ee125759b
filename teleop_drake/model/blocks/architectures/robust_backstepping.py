"""Adaptive backstepping with robust terms beside the networks."""

from dataclasses import field
from typing import ClassVar

import numpy as np

from teleop_drake.loops.framework.validation import (
    CheckNumber,
    Config,
    FixedFields,
    Number,
    Range,
    Refuse,
)
from teleop_drake.model.blocks.architectures.adaptive_backstepping import (
    AdaptiveBackstepping,
    AdaptiveBacksteppingConfig,
)
from teleop_drake.model.blocks.architectures.base import Facts
from teleop_drake.model.laws.backstepping import BacksteppingGains
from teleop_drake.model.laws.gaussian_network import GaussianNetwork
from teleop_drake.model.laws.robust_backstepping import (
    RobustBounds,
    robust_errors,
    robust_rate,
)


class RobustBackstepping(AdaptiveBackstepping):
    """AdaptiveBackstepping with terms that dominate the errors of its networks.

        damping of s            G1 s + rho1 P s/sqrt(|P s|^2 + eps1^2)
        subtracted from dF_c/dt rho1 Psi^-1 H w/sqrt(|w|^2 + eps1^2)
                                + rho3 z/sqrt(|z|^2 + eps3^2)

    The law, with w and H and the proof of its ultimate bound, is
    `laws.robust_backstepping`. Ports, state, initial value and direct
    feedthrough are those of AdaptiveBackstepping. With rho1 = rho3 = 0, the law is that
    of AdaptiveBackstepping as well.

    | parameter | name      | unit    |
    |-----------|-----------|---------|
    | 0         | Lambda    | m/(N s) |
    | 1         | G1        | 1/s     |
    | 2         | G2        | 1/s     |
    | 3         | P         | -       |
    | 4         | beta1     | -       |
    | 5         | beta2     | -       |
    | 6         | beta3     | -       |
    | 7         | nu1       | -       |
    | 8         | nu3       | -       |
    | 9         | Upsilon   | -       |
    | 10        | Psi0      | 1/kg    |
    | 11        | Psi_min   | 1/kg    |
    | 12        | rho1      | m/s^2   |
    | 13        | eps1      | -       |
    | 14        | rho3      | N/s     |
    | 15        | eps3      | -       |

    Args:
        gains: The constants of the law of chapters 4 and 5.
        bounds: The bounds and the widths of the robust terms.
        network: The basis functions of both networks, with n inputs in m.
    """

    law = ("robust_backstepping", robust_rate, robust_errors)

    numeric_parameters: ClassVar = {
        **AdaptiveBackstepping.numeric_parameters,
        "rho1": Range("m/s^2", minimum=0),
        "eps1": Range(above=0),
        "rho3": Range("N/s", minimum=0),
        "eps3": Range(above=0),
    }

    def __init__(
        self,
        gains: BacksteppingGains,
        bounds: RobustBounds,
        network: GaussianNetwork,
    ):
        for name in ("rho1", "rho3"):
            CheckNumber(name, getattr(bounds, name), minimum=0)
        for name in ("eps1", "eps3"):
            CheckNumber(name, getattr(bounds, name), above=0)
        AdaptiveBackstepping.__init__(self, gains=gains, network=network, bounds=bounds)


@Config
class RobustTermsConfig(FixedFields):
    """The bounds of the robust terms; all of their defaults are assumed.

    The scale of s is the commanded speed |v_d|. The scale of z is |v_d|/Lambda, the
    force that has the same weight in s. A null width of smoothing takes the scale of
    its variable.
    """

    # rho1, bound of the networks' error in ds/dt, m/s^2, >= 0. 0 leaves the terms with
    # rho1 out. With a delay they do harm, as a larger G1 does. Assumed.
    acceleration_bound: float = Number(0.0, "m/s^2", minimum=0)
    # eps1, width of smoothing of P s (in m/s if P = 1), > 0. Null: |v_d| times the
    # largest eigenvalue of P. Assumed.
    velocity_width: float | None = Number(None, "m/s", above=0)
    # rho3, bound of the networks' error in dF_e/dt, N/s, >= 0. Null: the smallest
    # eigenvalue of G2 times |v_d|/Lambda, the response of G2 to a z of that scale.
    # Assumed.
    force_rate_bound: float | None = Number(None, "N/s", minimum=0)
    # eps3, width of smoothing of z, N, > 0. Null: |v_d|/Lambda. Assumed.
    force_width: float | None = Number(None, "N", above=0)

    def Bounds(self, gains: BacksteppingGains, facts: Facts, path: str) -> RobustBounds:
        """Returns the bounds with every default derived; a width may not be 0."""
        speed = float(np.linalg.norm(facts.velocity))
        force = speed / float(np.linalg.eigvalsh(gains.Lambda)[-1])
        eps1 = self.velocity_width
        if eps1 is None:
            eps1 = float(np.linalg.eigvalsh(gains.P)[-1]) * speed
        rho3 = self.force_rate_bound
        if rho3 is None:
            rho3 = float(np.linalg.eigvalsh(gains.G2)[0]) * force
        eps3 = force if self.force_width is None else self.force_width
        for name, width in (("velocity_width", eps1), ("force_width", eps3)):
            if not width > 0:
                Refuse(f"{path}.{name}", None, "given where no velocity is commanded")
        return RobustBounds(
            rho1=self.acceleration_bound, eps1=eps1, rho3=rho3, eps3=eps3
        )


@Config
class RobustBacksteppingConfig(AdaptiveBacksteppingConfig):
    """Adaptive backstepping with robust terms; see laws.robust_backstepping."""

    kind = "robust_backstepping"

    robust: RobustTermsConfig = field(default_factory=RobustTermsConfig)

    def Numbers(self) -> None:
        """Returns None: the bounds of the robust terms derive from gains and facts."""

    def Check(self, path: str, num_axes: int) -> None:
        """Checks each field, also those of the robust terms."""
        super().Check(path, num_axes)
        self.robust.CheckNumbers(f"{path}.robust")

    def MakeControlLaw(self, facts: Facts, path: str) -> RobustBackstepping:
        """Makes the law."""
        gains = self.Resolve(facts, path)
        return RobustBackstepping(
            gains=gains,
            bounds=self.robust.Bounds(gains, facts, f"{path}.robust"),
            network=self.network.MakeNetwork(),
        )
