"""From a Diagram to machine code that computes the same, and runs of it.

`flatten`, the kernels of Drake's blocks and `program` make a Program of a Diagram.
`run` integrates it by Dormand-Prince 5(4), with delays, modes and events (`advance`).
"""
