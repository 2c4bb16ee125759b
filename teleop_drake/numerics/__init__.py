"""Numerical methods: interpolation, sample history, roots, margins, state space."""
