"""What a block tells of itself, and what is made of it for Drake."""

from teleop_drake.kernel.block import KernelBlock
from teleop_drake.kernel.kernel import (
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
    "Kernel",
    "KernelBlock",
    "Name",
    "Packet",
    "Term",
    "Transition",
    "times",
]
