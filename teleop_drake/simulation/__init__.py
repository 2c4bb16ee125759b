"""Runs a scenario and records it."""

from teleop_drake.simulation.simulate import (
    MakeDiagram,
    simulate,
    simulate_ensemble,
)

__all__ = [
    "MakeDiagram",
    "simulate",
    "simulate_ensemble",
]
