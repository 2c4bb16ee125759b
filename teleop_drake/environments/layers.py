"""Layers of material along an axis."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from teleop_drake.environments.base import EnvironmentConfig
from teleop_drake.environments.layered_force_field import (
    CheckLayerValues,
    LayeredForceField,
    LayerSurfaces,
)
from teleop_drake.environments.surface import Surface, UnitNormal
from teleop_drake.validation import REQUIRED, CheckNumber, FixedFields, Refuse


@dataclass(kw_only=True, eq=False)
class LayerConfig(FixedFields):
    """One layer of the environment, from its start to the next one's (eq. 2.14).

    force = stiffness (x - reference) + damping v_x along the direction of the layers,
    and lateral_stiffness times the distance of the tool from its axis across it.
    """

    # Unique, letters, digits and _ only: overrides address a layer by it.
    name: str = REQUIRED
    # Where the layer begins, m, ascending; the first may be -.inf.
    start: float = REQUIRED
    # N/m, >= 0.
    stiffness: float = 0.0
    # N s/m, >= 0.
    damping: float = 0.0
    # Where the spring is relaxed, m.
    reference: float = 0.0
    # N/m, >= 0, across the direction of the layers; assumed: the thesis has none. It
    # pulls to the line through the tool's start along that direction.
    lateral_stiffness: float = 0.0


@dataclass(kw_only=True, eq=False)
class LayersEnvironmentConfig(EnvironmentConfig):
    """Layers along an axis (eq. 2.14 to 2.16); no force in front of the first."""

    kind = "layers"

    layers: list[LayerConfig] = field(default_factory=list)
    # Into the layers, n entries, of any length but 0. What a layer calls x, its start
    # and its reference, are measured along it from the origin. Null: along x.
    direction: np.ndarray | None = None

    def Check(self) -> None:
        """Checks every layer and the direction."""
        CheckLayers("layers", self.layers)
        if self.direction is not None:
            UnitNormal(self.direction, np.size(self.direction), "direction")

    def MakeEnvironment(self, start: ArrayLike) -> LayeredForceField:
        """Makes the block; see EnvironmentConfig.MakeEnvironment.

        Raises:
            ValueError: If the starts do not ascend or a value is not allowed.
        """
        return LayeredForceField(
            layers=self.layers,
            num_axes=np.size(start),
            starts_inside=self._StartsInside(start),
            direction=self.direction,
            axis_point=start,
        )

    def Surfaces(self, start: ArrayLike) -> tuple[Surface, ...]:
        """Returns the surfaces that the block tells."""
        is_inside = self._StartsInside(start)
        return LayerSurfaces(self.layers, np.size(start), is_inside, self.direction)

    def _StartsInside(self, start: ArrayLike) -> bool:
        """Returns whether the tool starts in a layer."""
        x = np.asarray(start, dtype=float) @ UnitNormal(self.direction, np.size(start))
        return bool(self.layers) and bool(x >= self.layers[0].start)


def CheckLayers(path: str, layers: Sequence[LayerConfig]) -> None:
    """Checks layers, as a scenario has them.

    Args:
        path: Their field in a scenario, for messages.
        layers: By ascending start.

    Raises:
        ScenarioError: Naming the first bad field, its value and what is allowed.
    """
    names: set[str] = set()
    previous = -math.inf
    for i, layer in enumerate(layers):
        is_named = layer.name is not None and layer.name.isidentifier()
        if not is_named or layer.name in names:
            Refuse(
                f"{path}.{i}.name",
                layer.name,
                "unique, of letters, digits and _, not beginning with a digit",
            )
        place = f"{path}.{layer.name}"
        names.add(layer.name)
        if not (i == 0 and layer.start == -math.inf):
            CheckNumber(f"{place}.start", layer.start, "m")
        if i > 0 and layer.start <= previous:
            Refuse(
                f"{place}.start", layer.start, f"> {previous:g} m, the previous start"
            )
        previous = layer.start
        CheckLayerValues(place, layer)
