"""Runs a scenario and records it."""

from teleop_drake.simulation.simulate import MakeDiagram, simulate

__all__ = [
    "MakeDiagram",
    "simulate",
]
