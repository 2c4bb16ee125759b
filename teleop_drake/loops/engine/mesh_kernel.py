"""The kernel of a BarycentricMeshSystem: a table with linear interpolation."""

from typing import Any

import numpy as np

from teleop_drake.loops.engine.flatten import UnsupportedSystem
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.kernel import Kernel

# Of a mesh with more dimensions, each evaluation would compute too many corners.
_MOST_DIMENSIONS = 4


def barycentric(values: Array, *grids_and_input: Array) -> Array:
    """Returns the value of a mesh at an input, which is limited to the mesh (n).

    In a cell of the grid, let r be the shares of its edges at which the input lies. The
    corner with the set S of upper ends has the weight max(0, min_S r - max_not_S r),
    where the minimum of nothing is 1 and the maximum of nothing is 0. These are the
    barycentric coordinates in the simplex that contains the input.

    Args:
        values: The values at the points of the mesh (N, n), the first coordinate
            varying fastest.
        grids_and_input: The values of each coordinate in the mesh, ascending; and the
            input.
    """
    *grids, u = grids_and_input
    shares = []
    places = []
    for i, grid in enumerate(grids):
        k = np.clip(np.searchsorted(grid, u[i], side="right") - 1, 0, len(grid) - 2)
        width = grid[k + 1] - grid[k]
        shares.append(np.clip((u[i] - grid[k]) / width, 0.0, 1.0))
        places.append(k)
    total = np.zeros(values.shape[1])
    for corner in range(2 ** len(grids)):
        least = 1.0
        most = 0.0
        index = 0
        stride = 1
        for i, grid in enumerate(grids):
            is_upper = corner // 2**i % 2
            if is_upper:
                least = np.minimum(least, shares[i])
            else:
                most = np.maximum(most, shares[i])
            index = index + stride * (places[i] + is_upper)
            stride = stride * len(grid)
        total = total + np.maximum(least - most, 0.0) * values[index]
    return total


def MeshKernel(system: Any) -> Kernel:
    """Returns the kernel of a BarycentricMeshSystem.

    Raises:
        UnsupportedSystem: If its mesh has too many dimensions, or a coordinate with one
            value.
    """
    grids = [np.array(sorted(grid)) for grid in system.get_mesh().get_input_grid()]
    if len(grids) > _MOST_DIMENSIONS or min(map(len, grids)) < 2:
        allowed = f"1 to {_MOST_DIMENSIONS} dimensions of two or more values"
        raise UnsupportedSystem(system, f"compiled are meshes of {allowed}")
    names = {f"grid {i}": grid for i, grid in enumerate(grids)}
    return Kernel(
        parameters={"values": np.array(system.get_output_values().T), **names},
        outputs={"y0": (barycentric, "values", *names, "u0")},
    )
