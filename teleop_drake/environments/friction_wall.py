"""A wall along which the tool rubs."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from teleop_drake.environments.hunt_crossley import ContactWall, HuntCrossleyConfig
from teleop_drake.validation import Number


@dataclass(kw_only=True, eq=False)
class FrictionWallConfig(HuntCrossleyConfig):
    """A wall with Coulomb friction, F_t = friction F_n v_t/sqrt(v_t^2 + creep_speed^2).

    Its normal force F_n is that of hunt_crossley, with a linear spring by default.
    """

    kind = "friction_wall"

    # As in hunt_crossley; 1 is a linear spring.
    exponent: float = 1.0
    # mu, >= 0; assumed: 0.3.
    friction: float = Number(0.3, minimum=0)
    # v_s in m/s, > 0, below which friction grows with the speed; assumed: a hundredth
    # of the speeds of the tasks.
    creep_speed: float = Number(1e-3, "m/s", above=0)

    def MakeEnvironment(self, start: ArrayLike) -> ContactWall:
        """Makes the block; see EnvironmentConfig.MakeEnvironment."""
        (surface,) = self.Surfaces(start)
        return ContactWall(
            surface=surface,
            stiffness=self.stiffness,
            exponent=self.exponent,
            damping=self.damping,
            friction=self.friction,
            creep_speed=self.creep_speed,
        )
