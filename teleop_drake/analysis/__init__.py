"""Analyses of the loop: stability against the delay, transparency and energy."""
