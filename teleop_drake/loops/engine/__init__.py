"""Compiles a Diagram to a program, and integrates it without Drake's Simulator.

1. `flatten` lists the blocks of the Diagram and the connections of their ports.
2. `evaluator` collects the kernels of the blocks. Most blocks of this package describe
   themselves by a kernel. `primitives` makes the kernels of Drake's own systems, from
   their symbolic form (`expression_tape`), and `plant_kernel` that of a MultibodyPlant.
   `block_events` refuses a block that has more events than its kernel.
3. `program` sorts the terms of all kernels by dependence. The result is one function
   `evaluate(t, x, m, p, y, dx, wanted)`, which is interpreted or compiled.
4. `run` translates the delays and transitions into arrays (`problem`). `advance`
   integrates by Dormand-Prince 5(4) (`dormand_prince`), with `delays`, `transitions`
   and `breaks`. `past` transfers the signals in the delays from a Context and back.
   Drake draws the numbers of its `random_sources`.
5. `check` compares a user's own blocks and functions with Drake's callbacks.
"""
