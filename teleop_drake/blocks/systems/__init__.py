"""The blocks: one LeafSystem (or small Diagram) a file."""
