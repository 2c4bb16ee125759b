"""Layers of material along an axis."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import field
from typing import ClassVar

import numpy as np

from teleop_drake.loops.framework.arrays import Array, ArrayLike
from teleop_drake.loops.framework.surface import (
    CONTACT,
    EMPTY,
    PUNCTURE,
    Material,
    PlaneSurface,
    Surface,
    UnitNormal,
)
from teleop_drake.loops.framework.validation import (
    REQUIRED,
    CheckNumber,
    Config,
    FixedFields,
    Number,
    Range,
    Refuse,
)
from teleop_drake.loops.kernel import FixedBlock, Kernel, Term, Transition
from teleop_drake.loops.kernel.linear_part import LinearPart
from teleop_drake.model.blocks.environments.base import EnvironmentConfig
from teleop_drake.model.kinds import NumberNames
from teleop_drake.model.laws.layered_force import (
    LAYER_COLUMNS,
    layer_table,
    layered_force,
)


@Config
class LayerConfig(FixedFields):
    """One layer of the environment, from its start to that of the next (eq. 2.14).

    force = stiffness (x - reference) + damping v_x along the direction of the layers.
    Across that direction the force is lateral_stiffness times the distance of the tool
    from the axis.
    """

    # Unique name of letters, digits and _, by which overrides address the layer.
    name: str = REQUIRED
    # Position at which the layer begins, m, larger than that of the previous layer. The
    # first may be -.inf.
    start: float = REQUIRED
    # N/m, >= 0.
    stiffness: float = Number(0.0, "N/m", minimum=0)
    # N s/m, >= 0.
    damping: float = Number(0.0, "N s/m", minimum=0)
    # Position at which the spring is relaxed, m.
    reference: float = Number(0.0, "m")
    # Stiffness across the direction of the layers, N/m, >= 0. It pulls the tool to the
    # line through its start along that direction. Assumed: the thesis has none.
    lateral_stiffness: float = Number(0.0, "N/m", minimum=0)


@Config
class LayersEnvironmentConfig(EnvironmentConfig):
    """Layers along an axis (eq. 2.14 to 2.16); no force in front of the first."""

    kind = "layers"

    layers: list[LayerConfig] = field(default_factory=list)
    # Direction into the layers, n entries, of any length but 0. The x of a layer, its
    # start and its reference are measured along it from the origin. Null: along x.
    direction: np.ndarray | None = None

    def Check(self) -> None:
        """Checks every layer and the direction."""
        CheckLayers("layers", self.layers)
        if self.direction is not None:
            UnitNormal(self.direction, np.size(self.direction), "direction")

    def MakeEnvironment(self, start: ArrayLike) -> "LayeredForceField":
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
        """Returns the surfaces that the block declares."""
        return LayerSurfaces(
            self.layers, np.size(start), self._StartsInside(start), self.direction
        )

    def Numbers(self) -> NumberNames:
        """Returns the names of fields in the Contexts of blocks; see KindConfig."""
        return {
            f"layers.{i}.{name}": (f"{name}({layer.name})",)
            for i, layer in enumerate(self.layers)
            for name in LayeredForceField.numeric_parameters
        }

    def _StartsInside(self, start: ArrayLike) -> bool:
        """Returns whether the tool starts in a layer."""
        x = np.asarray(start, dtype=float) @ UnitNormal(self.direction, np.size(start))
        return bool(self.layers) and bool(x >= self.layers[0].start)


class LayeredForceField(FixedBlock):
    """Force of the tool on layered material, as the force sensor measures it.

        F_e = (k_e (x - reference) + d_e v_x) a + k_l (p - p_axis)   (2.14) to (2.16)

    with x = a . p along the unit vector a, the first axis if no direction is given, and
    the stiffness k_e, damping d_e and reference of the layer at x. Before the first
    layer there is no force. The last term is not from the thesis. It models tissue that
    guides a needle along an axis parallel to a. p_axis is the point of that axis that
    is nearest to the tool, and k_l the layer's lateral stiffness, 0 unless given.

    | port | name              | size | unit                                |
    |------|-------------------|------|-------------------------------------|
    | in   | tool_position     | n    | m                                   |
    | in   | tool_velocity     | n    | m/s                                 |
    | out  | environment_force | n    | N, exerted BY the robot             |
    | out  | layer             | 1    | index of the layer at x, -1: before |

    | parameter | name              | unit  |
    |-----------|-------------------|-------|
    | 0         | stiffness         | N/m   |
    | 1         | damping           | N s/m |
    | 2         | reference         | m     |
    | 3         | lateral_stiffness | N/m   |

    State (discrete, 1): the layer of the tool, counted from 1; 0: before the first.
    Between two layers the force jumps or bends. If the Context has an accuracy
    (context.SetAccuracy), the instant at which the tool leaves its layer is located and
    the force of a step is that of one layer throughout. A tool on a border is in the
    layer that begins there. Without an accuracy, each evaluation takes the layer at the
    current position, also within a step: the kernel's initial mode.

    Initial value: the layer at the initial position.

    Direct feedthrough: from both inputs to environment_force; from tool_position to
    layer.

    It models no friction, and its lateral spring does not stiffen with the depth of the
    needle. Punctured tissue is intact again when the tool comes back.

    Args:
        layers: The layers, by ascending start: LayerConfig(name="bone", start=1.1,
            stiffness=150.0, reference=1.1), for instance.
        num_axes: n, number of task axes.
        starts_inside: Whether the tool starts in a layer. The start of the first layer
            is then not a surface that it can hit.
        direction: Direction in which the layers follow each other, of any length but 0
            (n); None: along x.
        axis_point: A point in m (n) on the axis to which the lateral springs pull;
            None: the origin.

    Raises:
        ValueError: If the starts do not ascend or a value is not allowed.
    """

    is_compiled = True

    numeric_parameters: ClassVar = {
        "stiffness": Range("N/m", minimum=0),
        "damping": Range("N s/m", minimum=0),
        "reference": Range("m"),
        "lateral_stiffness": Range("N/m", minimum=0),
    }

    def __init__(
        self,
        layers: Sequence[LayerConfig],
        num_axes: int,
        *,
        starts_inside: bool = False,
        direction: ArrayLike | None = None,
        axis_point: ArrayLike | None = None,
    ):
        CheckLayers("layers", layers)
        self._surfaces = LayerSurfaces(layers, num_axes, starts_inside, direction)
        point = np.zeros(num_axes) if axis_point is None else axis_point
        # Element 0 of each array belongs to the empty space before the layers, mode 0.
        columns = LayerColumns(layers)
        limits = LayerLimits(columns["start"])
        names = ("empty", *(str(layer.name) for layer in layers))
        self.element_names = dict.fromkeys(self.numeric_parameters, names)
        has_border = bool(np.isfinite(limits["ends"]).any())
        law = ("layers", "axis", "mode", "tool_position", "tool_velocity")
        FixedBlock.__init__(
            self,
            "",
            Kernel(
                parameters={
                    **columns,
                    "axis": np.array([UnitNormal(direction, num_axes), point], float),
                    **limits,
                },
                derived={"layers": (layer_table, *LAYER_COLUMNS)},
                outputs={
                    "environment_force": (force_in_layer, *law),
                    "layer": (index_of_layer, "mode"),
                },
                initial_mode=LAYER_HERE,
                transitions={"leaves_layer": LEAVES_LAYER} if has_border else {},
            ),
            inputs={"tool_position": num_axes, "tool_velocity": num_axes},
            outputs={"environment_force": num_axes, "layer": 1},
            mode=[0.0],
        )

    def Surfaces(self) -> tuple[Surface, ...]:
        """Returns the surfaces at which layers begin, in order; see LayerSurfaces."""
        return self._surfaces

    def ForLinearModel(self, estimates: Array | None) -> LinearPart:
        """Returns that the tool stays in its layer."""
        return LinearPart(has_modes=True)


def force_in_layer(
    layers: Array, axis: Array, mode: Array, p_WT: Array, v_WT: Array
) -> Array:
    """Returns layered_force() in the layer of a mode; mode 0 is the empty space."""
    return layered_force(layers[int(mode[0])], axis, p_WT, v_WT)


def index_of_layer(mode: Array) -> Array:
    """Returns the index of the layer, -1 before the first one."""
    return mode - 1.0


def layer_at(layers: Array, axis: Array, p_WT: Array) -> Array:
    """Returns the mode at a position of the tool; a layer includes its start."""
    x = np.sum(p_WT * axis[0])
    return np.array([np.searchsorted(layers[:, 0], x, side="right") - 1.0])


def outside(before: Array, ends: Array, axis: Array, mode: Array, p_WT: Array) -> Array:
    """Returns the distance of the tool from the layer of the mode, m (1).

    It is negative inside. The layer includes its start but not its end: the distance is
    0 at the end, and at the largest number below the start.
    """
    x = np.sum(p_WT * axis[0])
    layer = int(mode[0])
    return np.array([max(x - ends[layer], before[layer] - x)])


LAYER_HERE: Term = (layer_at, "layers", "axis", "tool_position")
"""The term of the layer at the tool's position, which is the mode."""

LEAVES_LAYER = Transition(
    guard=(outside, "before", "ends", "axis", "mode", "tool_position"),
    mode=LAYER_HERE,
)
"""The transition when the tool leaves its layer."""


def LayerLimits(starts: Array) -> dict[str, Array]:
    """Returns the parameters of outside() for layers with given starts, m, ascending.

    They are the largest number below each layer, and the end of each layer.
    """
    return {
        "before": np.nextafter(starts, -math.inf),
        "ends": np.append(starts[1:], math.inf),
    }


def LayerSurfaces(
    layers: Sequence[LayerConfig],
    num_axes: int,
    starts_inside: bool,
    direction: ArrayLike | None = None,
) -> tuple[Surface, ...]:
    """Returns the surfaces at which layers begin, in their order.

    CONTACT is the start of the stiffest layer, if it follows a softer layer or empty
    space. PUNCTURE is the end of the first layer that is followed by a softer one. The
    other surfaces have the name of the layer that begins there. A layer with lateral
    stiffness has no Material, because it is more than one spring and damper.

    Args:
        layers: By ascending start.
        num_axes: n, number of task axes.
        starts_inside: Whether the tool starts in a layer, so that there is no empty
            space in front of the first one.
        direction: Direction in which the layers follow each other (n); None: along x.
    """
    starts_inside |= bool(layers) and layers[0].start == -math.inf
    behind = [] if starts_inside else [LayerConfig(name=EMPTY, start=-math.inf)]
    names = {
        PuncturePosition(layers): PUNCTURE,
        ContactPosition([*behind, *layers]): CONTACT,
    }
    normal_W = UnitNormal(direction, num_axes)
    surfaces = []
    for layer in layers:
        own = f"layer {layer.name}" if layer.name in (CONTACT, PUNCTURE) else layer.name
        material = None
        if not layer.lateral_stiffness:
            material = Material(
                name=layer.name,
                stiffness=layer.stiffness,
                damping=layer.damping,
                relaxed=layer.reference,
            )
        name = names.get(layer.start, own)
        surfaces.append(PlaneSurface(name, layer.start, normal_W, material))
    return tuple(surfaces)


def LayerColumns(layers: Sequence[LayerConfig]) -> dict[str, Array]:
    """Returns the parameters of layers as arrays, keyed by LAYER_COLUMNS.

    The first entry of each array belongs to the empty space before the layers.

    Args:
        layers: By ascending start.
    """
    return {
        name: np.array(
            [-math.inf if name == "start" else 0.0]
            + [getattr(layer, name) for layer in layers]
        )
        for name in LAYER_COLUMNS
    }


def ContactPosition(layers: Sequence[LayerConfig]) -> float | None:
    """Returns the position of the hard surface in m; None: there is none.

    It is the start of the stiffest layer, if the layer before it is softer.
    """
    if not layers:
        return None
    i = max(range(len(layers)), key=lambda k: layers[k].stiffness)
    if i == 0 or layers[i - 1].stiffness >= layers[i].stiffness:
        return None
    return layers[i].start


def PuncturePosition(layers: Sequence[LayerConfig]) -> float | None:
    """Returns the position in m at which the tool punctures a layer, or None.

    It is the end of the first layer that is followed by a softer one.
    """
    for before, after in itertools.pairwise(layers):
        if after.stiffness < before.stiffness:
            return after.start
    return None


def CheckLayers(path: str, layers: Sequence[LayerConfig]) -> None:
    """Checks the layers of a scenario.

    Args:
        path: The field of the layers in a scenario, for messages.
        layers: By ascending start.

    Raises:
        ScenarioError: Naming the first bad field, its value and what is allowed.
    """
    names: set[str] = set()
    previous = -math.inf
    for i, layer in enumerate(layers):
        if not isinstance(layer, LayerConfig):
            Refuse(f"{path}.{i}", layer, "a LayerConfig(name=..., start=...)")
        if not layer.name.isidentifier() or layer.name in names:
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
        layer.CheckNumbers(place)
