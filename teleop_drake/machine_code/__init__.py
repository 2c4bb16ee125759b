"""Functions of numbers and arrays as machine code."""
