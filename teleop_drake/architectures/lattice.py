"""The lattice of the Gaussian networks, as plain data."""

import math
from dataclasses import dataclass

import numpy as np

from teleop_drake.laws.gaussian_network import GaussianNetwork
from teleop_drake.validation import (
    REQUIRED,
    CheckVector,
    FixedFields,
    Number,
    Refuse,
    Show,
)

MAX_BASIS_FUNCTIONS = 10_000
"""Largest lattice that a network may have, so that a typing error cannot exhaust the
memory."""


@dataclass(kw_only=True, eq=False)
class NetworkConfig(FixedFields):
    """Lattice of the Gaussian networks (thesis eq. 3.1); the input is p_WT."""

    # Corners of the lattice of means, m, n entries each, lower < upper.
    lower: np.ndarray = REQUIRED
    upper: np.ndarray = REQUIRED
    # Means along each axis, n entries, >= 1.
    count: list[int] = REQUIRED
    # Width of the Gaussians in units of the lattice spacing, > 0.
    width: float = Number(1.0, "lattice spacings", above=0)

    @property
    def is_given(self) -> bool:
        """Whether any of the fields that have no default is there."""
        return any(item is not None for item in (self.lower, self.upper, self.count))

    def Check(self, path: str, num_axes: int) -> None:
        """Checks every field.

        Raises:
            ScenarioError: Naming the first bad field, its value and what is allowed.
        """
        n = num_axes
        CheckVector(f"{path}.lower", self.lower, n, "m")
        CheckVector(f"{path}.upper", self.upper, n, "m")
        if not np.all(self.lower < self.upper):
            Refuse(
                f"{path}.upper",
                self.upper,
                f"> {path}.lower = {Show(self.lower)} m on every axis",
            )
        count = self.count
        if count is None or len(count) != n or min(count) < 1:
            Refuse(f"{path}.count", count, f"a list of {n} whole numbers >= 1")
        if math.prod(count) > MAX_BASIS_FUNCTIONS:
            Refuse(f"{path}.count", count, f"at most {MAX_BASIS_FUNCTIONS} in all")
        self.CheckNumbers(path)

    def MakeNetwork(self) -> GaussianNetwork:
        """Makes the basis functions.

        Raises:
            ValueError: If a field is not allowed.
        """
        return GaussianNetwork(
            lower=self.lower, upper=self.upper, count=self.count, width=self.width
        )
