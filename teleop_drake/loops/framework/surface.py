"""Surfaces of an environment, and the material behind them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram, System

from teleop_drake.loops.framework.arrays import Array, ArrayLike, Record
from teleop_drake.loops.framework.validation import CheckVector, Refuse, Show

CONTACT = "contact"
"""Name of the hard surface, at which the operator perceives contact."""

PUNCTURE = "puncture"
"""Name of the surface at which the tool leaves the material that it punctures."""

EMPTY = "empty"
"""Name of the space in front of all surfaces."""


@dataclass(frozen=True, kw_only=True)
class Material:
    """A material that acts as one spring and damper along a normal (2.14).

    The force on it is stiffness (p_WT . normal - relaxed) + damping v_WT . normal.

    Attributes:
        name: Name of the material.
        stiffness: k_e in N/m.
        damping: d_e in N s/m.
        relaxed: p_WT . normal at which the spring is relaxed, in m.
    """

    name: str
    stiffness: float
    damping: float
    relaxed: float

    def Force(self, position: float, velocity: float) -> float:
        """Returns the force on the material in N.

        Args:
            position: p_WT . normal in m.
            velocity: v_WT . normal in m/s.
        """
        return self.stiffness * (position - self.relaxed) + self.damping * velocity


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane at which the force of an environment jumps or is not smooth.

    Attributes:
        name: CONTACT, PUNCTURE or any other name.
        point_W: A point on the surface in m (n).
        normal_W: The unit normal, which points into the material (n).
        material: The material behind the surface, up to the next surface of a stack of
            parallel ones. None: the force is not that of one spring and damper.

    Raises:
        ValueError: If the sizes of the vectors differ or the normal is no unit vector.
    """

    name: str
    point_W: Array
    normal_W: Array
    material: Material | None = None

    def __post_init__(self) -> None:
        """Converts the vectors to arrays and checks them."""
        point_W, normal_W = (
            np.array(x, dtype=float) for x in (self.point_W, self.normal_W)
        )
        if point_W.ndim != 1 or point_W.shape != normal_W.shape:
            Refuse(
                f"{self.name}.point_W",
                point_W,
                f"as many numbers as normal_W = {Show(normal_W)} has",
            )
        if np.isnan(point_W).any():
            Refuse(f"{self.name}.point_W", point_W, "a list of numbers (m)")
        if not math.isclose(np.linalg.norm(normal_W), 1.0, rel_tol=1e-5):
            Refuse(f"{self.name}.normal_W", normal_W, "a unit vector")
        object.__setattr__(self, "point_W", point_W)
        object.__setattr__(self, "normal_W", normal_W)

    def Along(self, vector: ArrayLike) -> Any:
        """Returns the component of vectors (..., n) along the normal (...)."""
        # Faster than a matrix product; it is evaluated for each piece of a run.
        return np.einsum("...i,i", np.asarray(vector, dtype=float), self.normal_W)

    def Depth(self, p_WT: ArrayLike) -> Any:
        """Returns the depth of points (..., n) behind the surface in m (...).

        It is negative in front of the surface.
        """
        return self.Along(p_WT) - self.Along(self.point_W)

    @classmethod
    def FromRecord(cls, record: Record) -> "Surface":
        """Returns the surface of a record that dataclasses.asdict() has made."""
        material = record["material"]
        return cls(**{**record, "material": material and Material(**material)})


def UnitNormal(
    direction: ArrayLike | None, num_axes: int, path: str = "environment.direction"
) -> Array:
    """Returns the unit vector (n) of a direction, along x for None.

    Args:
        direction: A vector of any length but 0 (n); with six axes it has three entries.
            None: along x.
        path: The field of the direction in a scenario, for messages.

    Raises:
        ScenarioError: If the direction is not allowed.
    """
    if direction is None:
        return np.eye(num_axes)[0]
    CheckVector(path, direction, min(num_axes, 3), "not all 0")
    vector = np.asarray(direction, dtype=float)
    largest = np.abs(vector).max(initial=0.0)
    if largest == 0:
        Refuse(path, direction, "a vector whose length is not 0")
    vector = vector / largest  # Its square neither overflows nor vanishes.
    return np.pad(vector / np.linalg.norm(vector), (0, num_axes - vector.size))


def PlaneSurface(
    name: str, start: float, normal_W: Array, material: Material | None = None
) -> Surface:
    """Returns the surface on which p_WT . normal is `start`.

    Args:
        name: Name of the surface.
        start: Position of the plane along the normal in m; may be infinite.
        normal_W: The unit normal (n).
        material: The material behind the plane; see Surface.
    """
    point_W = np.zeros_like(normal_W)
    # The product of 0 and an infinite start would be NaN.
    is_along = normal_W != 0
    point_W[is_along] = start * normal_W[is_along]
    return Surface(name, point_W, normal_W, material)


def SurfacesOf(system: System) -> tuple[Surface, ...] | None:
    """Returns the surfaces that an environment declares; None: it declares none.

    Args:
        system: A system with a method Surfaces(), or a Diagram of such systems.
    """
    tell: Callable[[], Sequence[Surface]] | None = getattr(system, "Surfaces", None)
    if tell is not None:
        return tuple(tell())
    if not isinstance(system, Diagram):
        return None
    told = [SurfacesOf(part) for part in system.GetSystems()]
    known = [surfaces for surfaces in told if surfaces is not None]
    return tuple(surface for part in known for surface in part) if known else None


def SurfacesIn(systems: Mapping[str, System]) -> tuple[Surface, ...] | None:
    """Returns the surfaces of the environment; None if it does not report any.

    Args:
        systems: The systems of the diagram, by their paths.
    """
    if "environment" not in systems:
        return ()
    return SurfacesOf(systems["environment"])


def FindSurface(surfaces: Sequence[Surface], name: str) -> Surface | None:
    """Returns the first surface with a given name, or None."""
    return next((surface for surface in surfaces if surface.name == name), None)


def ShownNormal(surfaces: Sequence[Surface], num_axes: int) -> Array:
    """Returns the direction (n) along which positions are reported.

    It is the normal of the contact surface. If there is none, it is the normal of the
    puncture surface. If there is neither, it is the x axis.
    """
    for name in (CONTACT, PUNCTURE):
        surface = FindSurface(surfaces, name)
        if surface is not None:
            return surface.normal_W
    return np.eye(num_axes)[0]


def LastPassed(surfaces: Sequence[Surface], p_WT: ArrayLike) -> Surface | None:
    """Returns the nearest of the surfaces that are in front of a point, or None.

    Args:
        surfaces: The surfaces; one that contains the point counts as in front of it.
        p_WT: The point in m (n).
    """
    passed = [x for x in surfaces if x.Depth(p_WT) >= 0]
    return min(passed, key=lambda x: float(x.Depth(p_WT)), default=None)


def MaterialAt(surfaces: Sequence[Surface], p_WT: ArrayLike) -> Material | None:
    """Returns the material behind the surface that LastPassed() returns, or None.

    Args:
        surfaces: The surfaces.
        p_WT: The point in m (n).
    """
    surface = LastPassed(surfaces, p_WT)
    return None if surface is None else surface.material


def StackNormal(surfaces: Sequence[Surface]) -> Array | None:
    """Returns the normal of a stack: parallel surfaces, all with a material.

    The force of a stack is known everywhere: it is zero in front of the first surface,
    and follows the law of the material behind each surface.

    Returns:
        The normal (n), or None if the surfaces are not a stack.
    """
    if not surfaces or any(surface.material is None for surface in surfaces):
        return None
    normal = surfaces[0].normal_W
    is_parallel = all(np.array_equal(surface.normal_W, normal) for surface in surfaces)
    return normal if is_parallel else None
