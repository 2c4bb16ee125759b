"""Surfaces of an environment, and the material behind them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram, System

from teleop_drake.arrays import Array, ArrayLike, Record
from teleop_drake.validation import CheckVector, Refuse, Show

CONTACT = "contact"
"""Name of the hard surface: where the operator perceives contact."""

PUNCTURE = "puncture"
"""Name of the surface at which the tool leaves the material that yields."""

EMPTY = "empty"
"""What the space in front of all surfaces is called."""


@dataclass(frozen=True, kw_only=True)
class Material:
    """One spring and damper along the normal of a surface (2.14).

    The force on it is stiffness (p_WT . normal - relaxed) + damping v_WT . normal.

    Attributes:
        name: What it is called.
        stiffness: k_e in N/m.
        damping: d_e in N s/m.
        relaxed: p_WT . normal at which the spring is relaxed, in m.
    """

    name: str
    stiffness: float
    damping: float
    relaxed: float

    def Force(self, position: float, velocity: float) -> float:
        """Returns the force on it in N.

        Args:
            position: p_WT . normal in m.
            velocity: v_WT . normal in m/s.
        """
        return self.stiffness * (position - self.relaxed) + self.damping * velocity


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane at which the force of an environment jumps or is not smooth.

    Attributes:
        name: What it is called: CONTACT, PUNCTURE or a user's own name.
        point_W: A point on it in m (n).
        normal_W: Its unit normal, which points into the material (n).
        material: What is behind it, as far as the next surface of a stack of parallel
            ones. None: something else than one spring and damper.

    Raises:
        ValueError: If the vectors do not fit together or the normal has no direction.
    """

    name: str
    point_W: Array
    normal_W: Array
    material: Material | None = None

    def __post_init__(self) -> None:
        """Turns vectors of other types into arrays, and checks them."""
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
        # Quicker than a matrix product for each piece of a run.
        return np.einsum("...i,i", np.asarray(vector, dtype=float), self.normal_W)

    def Depth(self, p_WT: ArrayLike) -> Any:
        """Returns how far points (..., n) are behind the surface in m (...).

        It is negative in front of it.
        """
        return self.Along(p_WT) - self.Along(self.point_W)

    @classmethod
    def FromRecord(cls, record: Record) -> "Surface":
        """Returns the surface that dataclasses.asdict() has made a record of."""
        material = record["material"]
        return cls(**{**record, "material": material and Material(**material)})


def UnitNormal(
    direction: ArrayLike | None, num_axes: int, path: str = "environment.direction"
) -> Array:
    """Returns the unit vector (n) of a direction, along x for None.

    Args:
        direction: Of any length but 0 (n), or None. With six axes it has three entries.
        path: Its field in a scenario, for messages.

    Raises:
        ScenarioError: If it is no direction.
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
        start: In m; may be infinite.
        normal_W: Its unit normal (n).
    """
    point_W = np.zeros_like(normal_W)
    # Not 0 times a start of -inf.
    is_along = normal_W != 0
    point_W[is_along] = start * normal_W[is_along]
    return Surface(name, point_W, normal_W, material)


def SurfacesOf(system: System) -> tuple[Surface, ...] | None:
    """Returns the surfaces that an environment tells, None if it tells none.

    Args:
        system: A system with a method Surfaces(), or a Diagram with such systems in it.
    """
    tell: Callable[[], Sequence[Surface]] | None = getattr(system, "Surfaces", None)
    if tell is not None:
        return tuple(tell())
    if not isinstance(system, Diagram):
        return None
    told = [SurfacesOf(part) for part in system.GetSystems()]
    known = [surfaces for surfaces in told if surfaces is not None]
    return tuple(surface for part in known for surface in part) if known else None


def FindSurface(surfaces: Sequence[Surface], name: str) -> Surface | None:
    """Returns the first surface of a name, None if there is none."""
    return next((surface for surface in surfaces if surface.name == name), None)


def ShownNormal(surfaces: Sequence[Surface], num_axes: int) -> Array:
    """Returns along which direction (n) positions are told: into a surface, else x.

    Into the contact surface if there is one, else into the puncture surface.
    """
    for name in (CONTACT, PUNCTURE):
        surface = FindSurface(surfaces, name)
        if surface is not None:
            return surface.normal_W
    return np.eye(num_axes)[0]


def LastPassed(surfaces: Sequence[Surface], p_WT: ArrayLike) -> Surface | None:
    """Returns the surface which is nearest in front of a point, None if none is.

    Args:
        p_WT: The point in m (n).
    """
    passed = [x for x in surfaces if x.Depth(p_WT) >= 0]
    return min(passed, key=lambda x: float(x.Depth(p_WT)), default=None)


def MaterialAt(surfaces: Sequence[Surface], p_WT: ArrayLike) -> Material | None:
    """Returns what is behind the surface that is nearest in front of a point.

    Args:
        p_WT: The point in m (n).
    """
    surface = LastPassed(surfaces, p_WT)
    return None if surface is None else surface.material


def StackNormal(surfaces: Sequence[Surface]) -> Array | None:
    """Returns the normal of a stack: parallel surfaces, all with a material.

    Of a stack the force is known everywhere: nothing in front of the first surface, and
    behind each of them the law of its material.

    Returns:
        The normal (n), None if they are no stack.
    """
    if not surfaces or any(surface.material is None for surface in surfaces):
        return None
    normal = surfaces[0].normal_W
    is_parallel = all(np.array_equal(surface.normal_W, normal) for surface in surfaces)
    return normal if is_parallel else None
