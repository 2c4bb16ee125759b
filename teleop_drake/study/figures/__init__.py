"""Figures of runs, sweeps, analyses and block diagrams, and the scene in 3-D."""
