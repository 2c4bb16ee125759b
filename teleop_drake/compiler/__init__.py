"""From a Diagram to machine code that computes the same."""
