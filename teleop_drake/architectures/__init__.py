"""The control architectures: a master side and a slave side each."""

from teleop_drake.architectures.kinds import (
    Architecture,
    CheckArchitecture,
    MakeArchitecture,
    ResolveController,
)

__all__ = [
    "Architecture",
    "CheckArchitecture",
    "MakeArchitecture",
    "ResolveController",
]
