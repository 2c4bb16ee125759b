"""Kernels: descriptions of blocks, and the Drake blocks that are made from them."""

from teleop_drake.loops.kernel.block import FixedBlock, KernelBlock, KernelIn
from teleop_drake.loops.kernel.kernel import (
    Delay,
    Kernel,
    Name,
    Packet,
    Term,
    Transition,
    times,
)

__all__ = [
    "Delay",
    "FixedBlock",
    "Kernel",
    "KernelBlock",
    "KernelIn",
    "Name",
    "Packet",
    "Term",
    "Transition",
    "times",
]
