"""Stability and energy of the loop: at which delay it fails, and why."""
