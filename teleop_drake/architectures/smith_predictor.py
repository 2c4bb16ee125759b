"""Direct force with a model of the robot at the master: Smith's predictor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_drake.architectures.base import (
    Architecture,
    ArchitectureConfig,
    MakeLawArchitecture,
)
from teleop_drake.architectures.facts import Facts
from teleop_drake.architectures.smith_predictor_master import SmithPredictorMaster
from teleop_drake.systems.direct_force import DirectForce
from teleop_drake.validation import CheckGain, CheckNumber, GainMatrix

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SmithPredictor:
    """Every number of the model; see SmithPredictorConfig for what they are."""

    mass: Array
    damping: Array
    stiffness: Array
    delay: float


@dataclass(kw_only=True, eq=False)
class SmithPredictorConfig(ArchitectureConfig):
    """Direct force with a model at the master; see SmithPredictorMaster."""

    kind = "smith_predictor"

    # M of the model, kg, > 0. Null: the apparent mass of the robot at its start.
    mass: np.ndarray | float | None = None
    # B, N s/m, >= 0. Null: that of the robot and, along x, of the layer at the start.
    damping: np.ndarray | float | None = None
    # K, N/m, >= 0. Null: that of the layer at the start, along x.
    stiffness: np.ndarray | float | None = None
    # T, s, >= 0. Null: T_f + T_r, the nominal round trip.
    delay: float | None = None

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field for itself.

        Args:
            path: The config's place in a scenario, for messages.
            num_axes: Number n of task axes.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        CheckGain(f"{path}.mass", self.mass, num_axes, may_be_null=True)
        for key in ("damping", "stiffness"):
            CheckGain(
                f"{path}.{key}",
                getattr(self, key),
                num_axes,
                may_be_zero=True,
                may_be_null=True,
            )
        if self.delay is not None:
            CheckNumber(f"{path}.delay", self.delay, "s", minimum=0)

    def Resolve(self, facts: Facts, path: str) -> SmithPredictor:
        """Returns the parameters with every default derived.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        n = facts.num_axes
        mass, damping, stiffness = self.mass, self.damping, self.stiffness
        if mass is None:
            mass = facts.Inertia(f"{path}.mass")
        if damping is None:
            damping = facts.StartDamping(f"{path}.damping")
        if stiffness is None:
            stiffness = facts.StartStiffness(f"{path}.stiffness")
        return SmithPredictor(
            mass=GainMatrix(mass, n),
            damping=GainMatrix(damping, n),
            stiffness=GainMatrix(stiffness, n),
            delay=facts.round_trip if self.delay is None else self.delay,
        )

    def MakeArchitecture(self, facts: Facts, path: str) -> Architecture:
        """Makes both sides.

        Args:
            facts: What the defaults derive from.
            path: The config's place in a scenario, for messages.

        Raises:
            ScenarioError: If a default cannot be derived.
        """
        model = self.Resolve(facts, path)
        law = DirectForce(num_axes=facts.num_axes)
        architecture = MakeLawArchitecture(law, facts.start.tolist())
        architecture.master_side = SmithPredictorMaster(
            mass=model.mass,
            damping=model.damping,
            stiffness=model.stiffness,
            delay=model.delay,
        )
        return architecture
