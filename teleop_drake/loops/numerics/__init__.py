"""Numerical methods: step polynomials, sample history, roots, margins, state space."""
