"""Exact linear models of a diagram, and the points at which they are taken."""
