"""Analysis of a scenario's loop: its stability, its energy and what is felt."""
