"""The error of a system that cannot be compiled."""

from pydrake.systems.framework import System


class UnsupportedSystem(ValueError):
    """A system that cannot be compiled; it runs in Drake's Simulator all the same.

    Args:
        system: The system.
        reason: Why not, as part of a sentence.
    """

    def __init__(self, system: System, reason: str):
        name = f"{type(system).__name__} {system.get_name()!r}"
        super().__init__(f"{name} cannot be compiled: {reason}")
