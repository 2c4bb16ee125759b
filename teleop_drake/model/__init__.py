"""The loop of the thesis: its laws, blocks, scenarios and tasks."""
