"""Blocks that are no delays."""
