"""Blocks that belong to no other group: one LeafSystem or small Diagram per file."""
