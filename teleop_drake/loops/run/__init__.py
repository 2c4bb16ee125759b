"""Simulates a scenario or a System, and records its signals."""

from teleop_drake.simulation.simulate import MakeDiagram, simulate
from teleop_drake.simulation.simulator import MakeSimulator

__all__ = [
    "MakeDiagram",
    "MakeSimulator",
    "simulate",
]
