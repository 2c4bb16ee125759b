"""Blocks that deliver a signal later, and what networks do to packets."""
